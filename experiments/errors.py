"""What stops a command: a line for people and the exit code of the program."""

from __future__ import annotations

import difflib
import errno
import signal
import sys
import traceback
import warnings
from pathlib import Path

from rom.campaign.campaign import terminal_line

BAD_INPUT, PROGRAM_FAULT, INTERRUPTED = 2, 1, 130
UNFIT = 3  # results are written, but no model describes the records
SETTINGS = "campaign.toml"
_USABLE = "a file or folder that can be used: name another"
_ALLOWED = "the right to read or write there: change it, or name another place"
_ROOM = "room for what is written: free some, or name another folder with --out"
_OPEN = "fewer open files: raise the limit, or use fewer --jobs"
_EXPECTED = {
    errno.ENOENT: "one that exists, or that can be made there: name another",
    errno.EEXIST: "a folder, or nothing there yet: name another place",
    errno.EISDIR: "a file: name one in it",
    errno.ENOTDIR: "a folder: name another place",
    errno.EACCES: _ALLOWED,
    errno.EPERM: _ALLOWED,
    errno.EROFS: _ALLOWED,
    errno.ENOSPC: _ROOM,
    errno.EFBIG: _ROOM,
    errno.EMFILE: _OPEN,
    errno.ENFILE: _OPEN,
    errno.ENAMETOOLONG: "a shorter name",
}
_PACKAGES = ("rom", "discovery", "experiments")


def existing(path: Path) -> Path:
    """Return a path that a person gave.

    Raises
    ------
    FileNotFoundError
        If nothing is there; the message names the nearest that is.
    """
    if path.exists():
        return path
    beside = [entry.name for entry in path.parent.iterdir()] if path.parent.is_dir() else []
    near = difflib.get_close_matches(path.name, beside, 1)
    hint = f"; the nearest is {path.parent / near[0]}" if near else ""
    raise FileNotFoundError(f"{path}: found no such file or folder, expected one that exists{hint}")


def a_campaign(path: Path) -> Path:
    """Return the path of a campaign that a person gave.

    Raises
    ------
    FileNotFoundError
        If nothing is there, or a folder without ``campaign.toml`` beside or above one that has it.
    """
    folder = existing(path)
    if not folder.is_dir() or (folder / SETTINGS).exists():
        return folder
    near = _nearest_campaign(folder.resolve())
    if near is None:  # the reader of campaigns says what is missing
        return folder
    here = Path.cwd()
    shown = near.relative_to(here) if near.is_relative_to(here) else near
    raise FileNotFoundError(
        f"{folder / SETTINGS}: found no such file, expected the settings of a campaign; "
        f"the nearest campaign is {shown}"
    )


def campaigns(paths: list[Path]) -> list[Path]:
    """Return the paths of campaigns that a person gave, as `a_campaign` each."""
    return [a_campaign(path) for path in paths]


def _nearest_campaign(folder: Path) -> Path | None:
    """Return a campaign in a folder, or else one beside it with a name like its own."""
    inside, beside = (
        {place.name: place for place in sorted(around.iterdir()) if (place / SETTINGS).is_file()}
        for around in (folder, folder.parent)
    )
    if inside:
        return next(iter(inside.values()))
    near = difflib.get_close_matches(folder.name.removesuffix("-results"), beside, 1, 0.5)
    return beside[near[0]] if near else None


def a_model(path: Path | None) -> Path | None:
    """Return the path of a model file that a person gave, if any.

    Raises
    ------
    FileNotFoundError
        If nothing is there.
    IsADirectoryError
        If it is a folder; the message names the model in it.
    """
    if path is None or not existing(path).is_dir():
        return path
    inside = path / "model.json"
    hint = f"; the nearest is {inside}" if inside.is_file() else ""
    raise IsADirectoryError(f"{path}: found a folder, expected a model.json{hint}")


def tell(error: BaseException) -> int:
    """Print an exception to standard error and return the exit code.

    A wrong call or bad input takes a line a fault, without a traceback; a fault of the program keeps it.
    """
    if isinstance(error, KeyboardInterrupt) or type(error).__name__ == "Abort":
        print("interrupted: no result is half-written, earlier ones are as they were", file=sys.stderr)
        return INTERRUPTED
    wrong_call = getattr(error, "format_message", None)  # how the command line library reports one
    if wrong_call is not None:
        text = str(wrong_call())
        shows_help = type(error).__name__ == "NoArgsIsHelpError"
        print(text if shows_help else terminal_line(text), file=sys.stderr)
        return BAD_INPUT
    if of_the_input(error):
        print(in_words(error), file=sys.stderr)
        return BAD_INPUT
    traceback.print_exception(error)
    print("boltlaw: this is a fault of the program, not of the input", file=sys.stderr)
    return PROGRAM_FAULT


def in_words(error: BaseException) -> str:
    """Return what an exception of the input says; of the system's own what was found, expected, and to do."""
    if not isinstance(error, OSError) or error.errno is None or not str(error).startswith("[Errno"):
        lines = [terminal_line(line) for line in str(error).split("\n")]
        return "\n".join(line for line in lines if line) or type(error).__name__
    place = error.filename2 or error.filename
    head = "" if place is None else f"{place}: "
    return terminal_line(f'{head}found "{error.strerror}", expected {_EXPECTED.get(error.errno, _USABLE)}')


def show_warnings_plainly() -> None:
    """Let a warning be one line, without the place in the code that raised it."""
    warnings.formatwarning = lambda message, *_, **__: f"warning: {message}\n"


def of_the_input(error: BaseException) -> bool:
    """Return whether an exception was raised about the input in so many words, or by the system about a file.

    A `ValueError` that a library raises below us, such as shapes that do not fit, is a fault of the program.
    """
    if isinstance(error, OSError):
        return True
    if not isinstance(error, ValueError):
        return False
    if type(error) is not ValueError:
        return type(error).__module__.partition(".")[0] in _PACKAGES
    if type(error.__cause__).__name__ == "RemoteTraceback":  # from another process, as text
        return any(line.strip().startswith("raise ") for line in str(error.__cause__).splitlines())
    return (traceback.extract_tb(error.__traceback__)[-1].line or "").startswith("raise ")


def terminated(number: int, _: object) -> None:
    """End as after an interrupt: scratch folders are removed, also those of processes at work."""
    signal.signal(number, signal.SIG_IGN)  # once is enough
    print("terminated: no result is half-written, earlier ones are as they were", file=sys.stderr)
    sys.exit(128 + number)
