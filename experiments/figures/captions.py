"""Titles and captions of the figures by name, in the order of a report."""

from discovery.criteria.criteria import CRITERIA, Criteria, percent

CAPTIONS: dict[str, tuple[str, str]] = {
    "experiment": (
        "Errors of all cells",
        "A row for each cell, a panel for each kind of error. Filled: the refined model, or the first law; "
        "hollow: the declared model, or gamma(T).",
    ),
    "closure-errors": (
        "Errors before and after",
        "Errors of the declared model, and after every effect that was added, on records that no fit has "
        "seen and on those fitted to.",
    ),
    "closure-records": (
        "Records by the declared and the refined model",
        "Left, what was measured and what the models make of it, through the same filters; right, what each "
        "leaves. The record of the declared model's largest relative error comes first.",
    ),
    "closure-residual": (
        "Where the residual lived",
        "Mean square of what the model leaves, over that of noise, along several views: hollow before, "
        "filled after. At the dashed line only noise is left.",
    ),
    "closure-correlation": (
        "Whether noise alone is left",
        "Correlation of what is left at neighbouring frequencies, and of tests that repeat each other (one "
        "body, like preload and hit), before and after. White noise stays within the bars in {noise} "
        "of cases.",
    ),
    "closure-force": (
        "The force that is left",
        "Force that the model leaves unbalanced where most of it is a function of motion: its mean over "
        "displacement and velocity, classes in even ratios, red where it pulls back, grey where no motion "
        "was; below, over the first three cycles of the record with the largest motion.",
    ),
    "closure-screened": (
        "What could explain the residual",
        "Share of the first residual that each effect alone could take away beyond what other numbers of the "
        "declared model could. Blue: added to the model.",
    ),
    "closure-effects": (
        "What was added",
        "Force of each added effect along the motion of training records, in the first 0.2 s after an "
        "impact, over the whole of a record without one; what the bolt's gauge shows of it, over the whole "
        "records; or, where it changes the law of loosening, the mean loss rate over a cycle of harmonic "
        "motion, dotted without it. In the legend: "
        "tension before the impact.",
    ),
    "closure-limits": (
        "What is excluded",
        "Smallest strength of each effect that these records would have shown with a probability of {shown}, "
        "over the strength that the catalogue takes as usual. Left of the shaded field a usual effect is "
        "excluded; in it, it may be there. Hollow: shown at no strength within the range.",
    ),
    "law-leader-board": (
        "Leader board of tension laws",
        "Left, the difference of the Bayesian information criterion (BIC) to the first law, smaller is "
        "better; right, the median error of the loss on preloads that the fit has not seen. Filled: the "
        "first law and those that these records cannot tell from it.",
    ),
    "law-trajectories": (
        "Tension after the hit",
        "Means of the measured tension over bins of time with 95 % limits, and the courses of the first laws "
        "and the paper's, for the preloads nearest to Fig. 15 of He et al. (2025). In the titles: tension "
        "before the hit (dotted). Shaded: what the scatter of the rate from test to test spans (one standard "
        "deviation), which no law is asked to follow.",
    ),
    "law-errors": (
        "Error of the loss against preload",
        "Every loosening record under the first laws and the paper's; 100 % is what a bolt that never "
        "loosens would score. Hollow: records held out. Errors beyond the axis are drawn at its edge.",
    ),
    "exponent-profile": (
        "How well the exponent is known",
        "Rise of the badness of fit when the exponent is held at a value and all else is fitted again. "
        "Shaded: the {confidence} set, below the dashed level and as far beyond as the identified model is "
        "uncertain.",
    ),
    "accuracy-complexity": (
        "Accuracy and complexity",
        "Cross-validated error of the loss over the free numbers of each law; the line is the best that so "
        "many numbers reach.",
    ),
    "term-inclusion": (
        "Which terms are chosen",
        "Wide: share of resamples of the preloads in which the first law of the race has a term of "
        "the form, whatever its numbers. Narrow: share of sparse fits on resampled records (FROLS) that took "
        "one among their first two. Near-equal forms share what one of them alone would have.",
    ),
    "records": (
        "Records by the identified model",
        "Left, what was measured and what the model makes of it, through the same filters; right, what is "
        "left. The record of the largest relative error comes first.",
    ),
    "final-tension-error": (
        "Error against preload",
        "Above, the error of the final tension as the paper takes it; below, the error of the loss "
        "itself, where 100 % is what a bolt that never loosens would score. Hollow: records "
        "in which the bolt tightened.",
    ),
    "overlays-loosening": (
        "Large impacts: measured and simulated",
        "Displacement of the struck body and tension of the bolt. The simulation passes through the "
        "measurement's own filter chain before it is drawn. Grey: raw tension.",
    ),
    "overlays-coupled": (
        "Small impacts: measured and simulated",
        "Displacement of the struck body and tension of the bolt, which a small impact should leave alone: "
        "what is lost there counts as noise.",
    ),
    "overlays-free": (
        "Free decay: measured and simulated",
        "The initial state is estimated from each record.",
    ),
    "overlays-driven": ("Forced runs: measured and simulated", "Displacement of the struck body."),
    "gamma-law": (
        "Rate of loosening over tension",
        "Net-loosening cases with 95 % limits, and the law with the 95 % band of its parameters.",
    ),
    "gamma-cases": (
        "Rate of loosening, case by case",
        "The value whose simulated final tension is the measured one; negative where the bolt tightened.",
    ),
    "tension-change": (
        "Change of tension",
        "Final minus initial tension with 95 % limits. Below the dashed line changes scatter, above it they "
        "repeat.",
    ),
    "tension-traces": (
        "Tension traces",
        "Measured tension, its non-oscillatory part, and the means before and after the impact (dotted). "
        "In the titles: initial tension and its change.",
    ),
    "joint-stiffness": (
        "Stiffness of the joint",
        "One estimate per record with 95 % limits, and the fitted law with its band. Of two bodies with a "
        "flexure each, in grey: the paper's modal estimates, crosses where damping is too heavy for them.",
    ),
    "joint-damping": (
        "Damping of the joint",
        "One estimate per record with 95 % limits, and the fitted law with its band. Of two bodies with a "
        "flexure each, in grey: the paper's modal estimates, crosses where damping is too heavy for them.",
    ),
    "first-mode-frequency": (
        "First mode",
        "Average-period frequency with 95 % limits, and the damped frequency of the identified model.",
    ),
    "frequency-responses": (
        "Bodies alone",
        "Measured frequency response without the bolt and the mode fitted to it.",
    ),
    "calibration": (
        "Calibration of the bolt",
        "Polynomial from strain reading to tension; ticks mark the tensions of the records.",
    ),
}


def caption(name: str, criteria: Criteria = CRITERIA) -> tuple[str, str]:
    """Return title and caption of a figure; the name itself in words where it has none.

    Parameters
    ----------
    name : str
        Of the figure.
    criteria : Criteria
        Those of its result file, whose numbers the caption states.
    """
    words = name.replace("-", " ").replace("_", " ").strip()
    title, text = CAPTIONS.get(name, (words[:1].upper() + words[1:], ""))
    return title, text.format(
        noise=criteria.level_of_noise,
        shown=percent(criteria.detection.probability),
        confidence=percent(criteria.ranking.confidence),
    )


def order(name: str) -> tuple[int, str]:
    """Return where a figure stands in a report."""
    names = list(CAPTIONS)
    return (names.index(name) if name in names else len(names), name)
