"""The report of a reproduction: published beside simulated errors, the thesis's figures, errata, calibration."""

from collections.abc import Sequence
from functools import partial

from ambient_studies.thesis.errata import Erratum
from ambient_studies.thesis.figures import error_figure, figure_sections
from ambient_studies.thesis.outcome import Outcome, outcome_table
from ambient_studies.thesis.published import VARIANTS, method_name
from ambient_studies.thesis.reproduction import TRAINING, Reproduction, as_json
from ambient_studies.thesis.tables import overview_table, scenario_sections
from ambient_trainer.report import Facts, Figure, Finding, Report, Section, Table

_ABOUT = (
    "The thesis (Estimating Ambient Temperature using Internal Sensors and Thermal Modelling in Mobile Phones) fits "
    "ten models to a phone in a heating chamber and scores them in six scenarios. Its measurements were never "
    "published. Here a simulated phone, calibrated to what can be recovered from the publication, goes through the "
    "same scenarios; the same models are fitted to scenario 5 and scored on runs that they did not see. Figures called "
    "published are the thesis's; figures called simulated were computed here."
)
_SCATTER = (
    "Solid: equal; dotted: a factor of two. A colour is a scenario, a symbol a model; point at one for its name. Model "
    "1 state-space single input is drawn as the thesis evidently evaluated it, with an offset that is fitted to the "
    "scenario (erratum 9)."
)
_CALIBRATION = (
    "Means and standard deviations of raw sensors at 20 degC, recovered from the thesis's published errors, and the "
    "simulated phone's."
)


def report_of(reproduction: Reproduction, errata: Sequence[Erratum], calibration: Sequence[Outcome]) -> Report:
    """What the reproduction shows; errata are for JSON and page, the calibration for the page, and both may be empty.

    Drawing its figures simulates the runs that figures 4.1 and 4.5 need besides.
    """
    rows, verdict = reproduction.evaluated.rows, reproduction.verdict
    verification, *others = scenario_sections(rows)
    shortfalls = Section(
        f"Not as in the thesis ({len(verdict.shortfalls)})", [Finding(each) for each in verdict.shortfalls], fold="open"
    )
    return Report(
        subject="Reproduction, simulated",
        title=f"The thesis on a simulated phone: {verdict.within_factor_two} of {verdict.compared} errors within a "
        "factor of two",
        lead=[Finding(verdict.headline, "result"), _ABOUT, Facts(_facts(reproduction))],
        sections=[
            Section("How like the thesis it is", [Figure(partial(error_figure, rows), _SCATTER), shortfalls]),
            verification,
            Section("The thesis's figures", figure_sections(reproduction), detail=True),
            *others,
            Section("Every method, every variant (simulated)", [overview_table(rows)]),
            Section("What the thesis gets wrong, computed", [_erratum(each) for each in errata], detail=True),
            Section(
                "How well the simulated phone is calibrated",
                [_CALIBRATION, outcome_table(calibration)] if calibration else [],
                detail=True,
            ),
            Section(
                "The methods",
                [
                    Finding(each.about, label=f"{method_name(each.name)}, {VARIANTS[each.variant]}")
                    for each in reproduction.methods
                ],
                detail=True,
            ),
        ],
        data=as_json(reproduction, errata),
    )


def _facts(reproduction: Reproduction) -> list[tuple[str, str]]:
    training = reproduction.runs.training
    hours = (training.time_s[-1] - training.time_s[0]) / 3600
    return [
        ("trained on", f"scenario {TRAINING}, simulated, {hours:.1f} h, {len(training.time_s):,} samples"),
        ("evaluated on", f"scenarios {', '.join(reproduction.runs.evaluated)}, simulated with other weather and noise"),
        ("estimates", "causal, from the first sensor sample on, unless they are called non-causal"),
        ("seed", str(reproduction.seed)),
    ]


def _erratum(erratum: Erratum) -> Section:
    rows = [(each.what, f"{each.value:.4g} {each.unit}") for each in erratum.figures]
    table = Table("", ("figure", "value"), rows)
    return Section(f"Erratum {erratum.number}: {erratum.title}", [erratum.statement, table])
