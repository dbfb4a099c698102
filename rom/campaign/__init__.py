"""A campaign folder: its settings, records, file formats, and the checks at the door.

What reads, writes or refuses files of a campaign belongs here; nothing that knows a model or a filter. May
import `rom.result_views` only.
"""
