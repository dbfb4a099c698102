"""Figures are made of whatever an identification holds, show the data, and leave matplotlib as it was."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from experiments.figures import closure, discovery
from experiments.figures import identification as figures
from experiments.figures.curves import damped_frequencies
from experiments.figures.style import COLUMN_MM, panels, save, tension_axis
from experiments.figures.tensions import thinned
from rom.campaign.campaign import WindowSettings
from rom.evaluation.error_measures import Comparison, simulate_measurement
from rom.identification.curve_fits import LawFit, fit_law, gamma_curve
from rom.identification.frequency_response import Estimate, Mode, frequency_response
from rom.identification.gamma_per_case import GammaEstimate
from rom.identification.identify import Identification
from rom.identification.joint import JointEstimate
from rom.identification.reduce import FirstMode, UncoupledTest
from rom.parameters.he_2025 import CALIBRATION, nominal_impact, paper_model
from rom.signals.calibration import Calibration, fit_calibration
from rom.signals.filters import FilterChain
from rom.signals.motion import Motion
from rom.signals.processing import Measurement, TensionRecord

RATE_HZ = 4800.0
TENSIONS = np.geomspace(6.0, 3000.0, 12)
WINDOWS = WindowSettings(initial_s=(0.0, 0.4), final_s=(1.0, 2.0))


def joint_and_fits() -> tuple[tuple[JointEstimate, ...], LawFit, LawFit]:
    laws = paper_model().link_laws["joint"]
    rng = np.random.default_rng(3)
    noise = np.exp(0.01 * rng.standard_normal((2, len(TENSIONS))))
    k, c = laws.stiffness(TENSIONS) * noise[0], laws.damping(TENSIONS) * noise[1]
    files = [f"records/coupled_{i:03d}.h5" for i in range(len(TENSIONS))]
    mode = FirstMode(Estimate(15.7, 0.01), Estimate(0.006, 0.0001))
    joint = tuple(
        JointEstimate(
            f, t, ki, ci, (0.01, 0.01), 0.5 if t < 200 else 0.1, "output error", mode, 1.1 * ki, 0.9 * ci
        )
        for f, t, ki, ci in zip(files, TENSIONS, k, c, strict=True)
    )
    covariance = 1e-4 * np.eye(len(TENSIONS))
    return (
        joint,
        fit_law([laws.stiffness], ["k_i", "alpha", "beta"], TENSIONS, k, covariance, files),
        fit_law([laws.damping], ["c_d", "c_i", "eta"], TENSIONS, c, covariance, files),
    )


def gamma_and_fit() -> tuple[tuple[GammaEstimate, ...], LawFit]:
    law = paper_model().link_laws["joint"].tension_rate
    assert law is not None
    value = gamma_curve(law, TENSIONS)
    files = [f"records/loosening_{i:03d}.h5" for i in range(len(TENSIONS))]
    names, covariance = ["gamma_d", "gamma_i", "rho"], 1e-4 * np.eye(len(TENSIONS))
    fit = fit_law([law], names, TENSIONS, value, covariance, files, gamma_curve)
    signs = np.where(np.arange(len(TENSIONS)) % 4 == 1, -1.0, 1.0)
    cases = tuple(
        GammaEstimate(
            f"records/loosening_{i:03d}.h5",
            t,
            t - s * min(0.2 * t, 3.0 if t < 850 else 0.5),
            0.05,
            s * g,
            0.1,
            False,
        )
        for i, (t, s, g) in enumerate(zip(TENSIONS, signs, value, strict=True))
    )
    return cases, fit


def uncoupled(hits: int = 1) -> UncoupledTest:
    model = paper_model().without_bolt()
    force = nominal_impact(20.0, RATE_HZ, 6.0)
    response = model.simulate({"lo": force}, RATE_HZ).acceleration["lo"]
    rng = np.random.default_rng(1)
    noisy = response + 1e-3 * rng.standard_normal((hits, len(response)))
    frf = frequency_response(np.tile(force, (hits, 1)), noisy, RATE_HZ)
    omega, ratio = np.sqrt(model.parameter("flexure_lo.stiffness.k").value / 8.625), 0.0155
    residue = 1 / (2j * 8.625 * omega * np.sqrt(1 - ratio**2))
    mode = Mode(Estimate(omega / (2 * np.pi), 1e-3), Estimate(ratio, 1e-4), residue, 1e-6)
    return UncoupledTest("records/uncoupled_lo.h5", "lo", frf, mode)


def measurement(tension: float, test: str = "loosening", peak: float = 1600.0) -> Measurement:
    """What the paper's model itself would measure."""
    force = nominal_impact(peak, RATE_HZ, 2.0)
    flat = np.full(len(force), tension)
    record = TensionRecord(flat, flat, RATE_HZ, tension, tension, 0.01, 0.01, 2700.0)
    still = Measurement(
        file=f"records/{test}_{tension:g}.h5", test=test, hold_out=False, preload_n=tension, rate_hz=RATE_HZ,
        samples=len(force), force={"lo": force}, force_noise={"lo": 0.0}, strongest_hz=15.8, motion={},
        impact_s=0.5, chain=FilterChain(5.0), tension=record, link={},
    )  # fmt: skip
    response = simulate_measurement(paper_model(), still)
    trace = np.asarray(response.tension)
    noisy = trace + 0.1 * np.sin(600 * response.time)
    motion = {body: Motion("acceleration", response.acceleration[body]) for body in ("lo", "so")}
    seen = replace(record, samples=noisy, non_oscillatory=trace, final=float(trace[-1]))
    return replace(still, motion=motion, tension=seen)


@pytest.fixture(scope="module")
def identification() -> Identification:
    joint, stiffness, damping = joint_and_fits()
    gamma, fit = gamma_and_fit()
    model = replace(paper_model(), calibration=CALIBRATION)
    return Identification(
        model, None, (uncoupled(),), joint, stiffness, damping, gamma=gamma, gamma_case_fit=fit, gamma_fit=fit
    )


ALL = {
    "calibration",
    "first-mode-frequency",
    "frequency-responses",
    "gamma-cases",
    "gamma-law",
    "joint-damping",
    "joint-stiffness",
    "overlays-coupled",
    "overlays-loosening",
    "tension-change",
    "tension-traces",
}


def test_everything_there_gives_every_figure_one_column_wide(
    identification: Identification, tmp_path: Path
) -> None:
    examples = [measurement(21.5), measurement(317.0), measurement(3000.0, "coupled", 28.0)]
    made = figures.identification_figures(identification, windows=WINDOWS, examples=examples)
    assert set(made) == ALL
    for name, figure in made.items():
        assert figure.get_figwidth() == pytest.approx(COLUMN_MM / 25.4)
        path = figures.save(figure, tmp_path / f"{name}.svg")
        assert ElementTree.parse(path).getroot().tag.endswith("svg")
        for axes in figure.axes:
            labels = axes.get_xlabel() + axes.get_ylabel()
            assert not labels or "[" in labels, f"{name}: an axis without unit: {labels}"


@pytest.mark.parametrize(
    ("lacking", "gone"),
    [
        ({"uncoupled": ()}, {"frequency-responses"}),
        ({"joint": (), "stiffness_fit": None, "damping_fit": None},
         {"first-mode-frequency", "joint-stiffness", "joint-damping"}),
        ({"gamma": (), "gamma_fit": None}, {"gamma-law", "gamma-cases", "tension-change"}),
        ({"stiffness_fit": None, "gamma_fit": None}, set()),
    ],
)  # fmt: skip
def test_missing_data_is_a_missing_figure(
    identification: Identification, lacking: dict[str, object], gone: set[str]
) -> None:
    made = figures.identification_figures(replace(identification, **lacking))  # type: ignore[arg-type]
    assert set(made) == ALL - gone - {"overlays-coupled", "overlays-loosening", "tension-traces"}


def test_a_structure_without_bolt_and_records_gives_nothing() -> None:
    assert figures.identification_figures(Identification(paper_model().without_bolt(), None)) == {}


def test_one_record_of_each_kind_is_enough(identification: Identification) -> None:
    one = replace(
        identification, joint=identification.joint[:1], gamma=identification.gamma[:1], stiffness_fit=None,
        damping_fit=None, gamma_fit=None,
    )  # fmt: skip
    made = figures.identification_figures(one)
    assert {"joint-stiffness", "gamma-law", "tension-change"} <= set(made)


def test_an_estimate_without_limits_is_still_a_point(identification: Identification) -> None:
    lost = replace(identification.joint[3], log_errors=(np.inf, np.nan))
    joint = (*identification.joint[:3], lost, *identification.joint[4:])
    case = replace(identification.gamma[0], log_error=np.inf, loss_error=np.nan)
    bound = replace(identification.gamma[2], gamma=1e10, at_bound=True)
    gamma = (case, bound, *identification.gamma[3:])
    made = figures.identification_figures(replace(identification, joint=joint, gamma=gamma))
    for figure in made.values():
        figure.draw_without_rendering()
        for axes in figure.axes:
            assert np.isfinite([*axes.get_xlim(), *axes.get_ylim()]).all()
    assert made["gamma-law"].axes[0].get_ylim()[1] < 1e10


def test_only_tightening_cases_have_no_law(identification: Identification) -> None:
    tight = tuple(g for g in identification.gamma if g.gamma < 0)
    made = figures.identification_figures(replace(identification, gamma=tight, gamma_fit=None))
    assert "gamma-cases" in made
    assert "gamma-law" not in made


def test_the_joint_figure_shows_the_estimates_and_the_law(identification: Identification) -> None:
    axes = figures.joint_stiffness(identification.joint, identification.stiffness_fit).axes[0]
    drawn = {line.get_label(): line for line in axes.get_lines()}
    curve = next(line for label, line in drawn.items() if str(label).startswith("Fitted law"))
    x, y = (np.asarray(values, dtype=float) for values in curve.get_data())
    assert identification.stiffness_fit is not None
    np.testing.assert_allclose(y, identification.stiffness_fit.law(x))
    shown = axes.containers[0].lines[0].get_ydata()  # type: ignore[attr-defined]
    np.testing.assert_allclose(shown, [estimate.stiffness for estimate in identification.joint])


def test_the_simulation_passes_through_the_filter_chain() -> None:
    record = measurement(317.0)
    axes = figures.overlays(figures.simulated(paper_model(), [record])).axes[0]
    measured, simulated = (np.asarray(line.get_ydata(), dtype=float) for line in axes.get_lines()[:2])
    np.testing.assert_allclose(simulated, measured, atol=1e-9 * np.abs(measured).max())


def test_a_record_that_cannot_be_simulated_is_left_out() -> None:
    lost = replace(measurement(317.0), tension=None, preload_n=None)
    assert figures.simulated(paper_model(), [lost]) == []


def test_coherence_is_drawn_where_it_was_measured() -> None:
    assert len(figures.frequency_responses([uncoupled(hits=1)]).axes) == 1
    assert len(figures.frequency_responses([uncoupled(hits=3)]).axes) == 2


def comparison(initial: float, measured: float, simulated: float) -> Comparison:
    return Comparison(
        "r.h5",
        "loosening",
        True,
        {},
        initial_tension=initial,
        measured_final=measured,
        simulated_final=simulated,
    )


def test_errors_are_shown_beside_no_loosening() -> None:
    model = [comparison(100.0, 90.0, 91.0), comparison(2000.0, 1999.0, 1999.2), comparison(50.0, 52.0, 49.0)]
    still = [replace(c, simulated_final=c.initial_tension) for c in model]
    above, below = figures.final_tension_errors(model, model[:1], still).axes
    points = {line.get_label(): line.get_ydata() for line in below.get_lines()}
    np.testing.assert_allclose(points["No loosening"], [100.0, 100.0])
    np.testing.assert_allclose(points["Model, training"], [10.0, 20.0])
    assert above.get_yscale() == "log"


def test_errors_that_differ_by_rounding_alone_have_an_axis() -> None:
    """Limits that differ in their last digit are the same to a logarithmic axis, which warns of them."""
    alike = [comparison(20.0, 10.0, 20.0), comparison(20.0, 10.0, 20.0 * (1 + 2e-15))]
    (figure,) = figures.validation_figures(alike).values()
    FigureCanvasAgg(figure).draw()
    assert all(high > 1.3 * low > 0 for low, high in (ax.get_ylim() for ax in figure.axes))


def test_rankings_and_residuals_that_differ_by_rounding_alone_have_axes() -> None:
    errors = {1: 100.0, 2: 100.0 * (1 + 4e-16), 3: 100.0}
    laws = [
        {"name": f"law {i}", "rank": i, "delta_bic": i, "free_numbers": i,
         "cross_validated_loss_error_percent_median": error} for i, error in errors.items()
    ]  # fmt: skip
    cases = [
        {"initial_tension_n": 10.0 + i, "loss_error_percent": {"law 1": error}} for i, error in errors.items()
    ]
    view = {"record": {f"{i}": error / 100.0 for i, error in errors.items()}}
    drawn = [
        discovery.leader_board({"laws": laws}),
        discovery.accuracy_and_complexity({"laws": laws}),
        discovery.errors_over_preload({"laws": laws, "cases": cases}),
        closure.residual_by_view({"residual": {"before": view, "after": view}}),
    ]
    for figure in drawn:
        FigureCanvasAgg(figure).draw()
        limits = [(ax.get_xscale(), *ax.get_xlim()) for ax in figure.axes]
        limits += [(ax.get_yscale(), *ax.get_ylim()) for ax in figure.axes]
        assert [high > 1.3 * low > 0 for scale, low, high in limits if scale == "log"] == [True]


def test_errors_need_a_loosening_record() -> None:
    coupled = Comparison("r.h5", "coupled", True, {"lo": 0.1}, initial_tension=9.0, measured_final=9.0)
    assert figures.validation_figures([coupled]) == {}
    assert set(figures.validation_figures([comparison(9.0, 8.0, 8.1)])) == {"final-tension-error"}


def test_a_calibration_shows_its_test_and_limits() -> None:
    rate, cycles = 100.0, 3
    phase = np.arange(int(60 * cycles * rate)) / rate / 60
    strain = 2.0 * np.abs(np.sin(np.pi * phase))
    force = Calibration(CALIBRATION).tension(strain)
    fitted = fit_calibration(force, rate, strain, rate)
    axes = figures.calibration_curve(fitted, np.array([100.0]), strain, force).axes[0]
    labels = {text.get_text() for text in axes.get_legend().get_texts()}  # type: ignore[union-attr]
    assert labels == {"Tensile test", "Calibration polynomial", "95 % limits", "Records"}


def test_the_damped_frequency_is_that_of_the_paper() -> None:
    assert damped_frequencies(paper_model(), 3000.0)[0] == pytest.approx(15.78, abs=0.02)


def test_a_thinned_trace_keeps_the_extremes_in_order() -> None:
    time = np.arange(100_000) / 4800
    samples = np.random.default_rng(0).standard_normal(len(time))
    thin_time, thin = thinned(time, samples, 200)
    assert len(thin) == 400
    assert np.all(np.diff(thin_time) >= 0)
    assert (thin.min(), thin.max()) == (samples.min(), samples.max())


@pytest.mark.parametrize("tension", [(220.0, 2200.0), (60.0, 700.0), (6.0, 3000.0)])
def test_labels_of_a_logarithmic_tension_lie_side_by_side(tension: tuple[float, float]) -> None:
    figure, axes = panels()
    grid = tension_axis(axes[0, 0], np.array(tension))
    axes[0, 0].plot(grid, grid)
    FigureCanvasAgg(figure).draw()
    low, high = axes[0, 0].get_xlim()
    labels = [t for minor in (False, True) for t in axes[0, 0].xaxis.get_ticklabels(minor=minor)]
    seen = [t for t in labels if t.get_text() and low <= t.get_position()[0] <= high]
    extents = sorted((box.x0, box.x1) for box in (label.get_window_extent() for label in seen))
    assert len(extents) >= 3
    assert all(right < left for (_, right), (left, _) in pairwise(extents))


def test_nothing_global_is_changed(identification: Identification) -> None:
    before = dict(mpl.rcParams)
    figures.identification_figures(identification)
    assert dict(mpl.rcParams) == before


def test_the_same_figure_is_the_same_file_and_a_wrong_suffix_is_refused(
    identification: Identification, tmp_path: Path
) -> None:
    paths = [
        figures.save(figures.gamma_law(identification.gamma, identification.gamma_fit), tmp_path / f"{i}.svg")
        for i in range(2)
    ]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    with pytest.raises(ValueError, match="is written as"):
        figures.save(Figure(), tmp_path / "a.jpeg")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.svg", "1.svg"]


def test_a_pdf_holds_its_letters_whatever_figures_were_written_before(tmp_path: Path) -> None:
    def written(name: str, label: str) -> bytes:
        figure, axes = panels()
        axes[0, 0].set_xlabel(label)
        with mpl.rc_context({"pdf.compression": 0}):
            return save(figure, tmp_path / f"{name}.pdf").read_bytes()

    first = written("first", "Tension $T$ [N]")
    rare = written("rare", "Zug Ж [N]")
    assert written("again", "Tension $T$ [N]") == first
    assert b"<0416>" in rare  # the letter's code beside its glyph: text can be copied
    assert b"<0416>" not in first
    assert b"<0054>" in first


def test_cases_that_did_not_loosen_are_shown_as_such() -> None:
    cases = [replace(case, gamma=0.0, final=case.initial) for case in gamma_and_fit()[0][:3]]
    (ax,) = figures.gamma_cases(cases).axes
    assert [line.get_label() for line in ax.lines if len(np.asarray(line.get_xdata())) == 3] == ["No change"]
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["No change"]
