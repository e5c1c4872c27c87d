"""The report of a comparison, section by section."""

import json
from collections.abc import Iterable, Mapping, Sequence

from model.scene.field import FieldLight
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.comparison.comparison import Comparison, EffectsTaken
from rigctl.comparison.input_attribution import InputAttribution
from rigctl.comparison.verdict import VERDICT_WORDS, not_judged, refusals, reservations, said_of, unjudged_lines
from rigctl.files.regions import Region
from rigctl.measurement.fault_terms import UNSEEN
from rigctl.measurement.measurement import Measurement
from rigctl.numbers.number_text import p_value
from rigctl.prediction.performance import NO_NOISE
from rigctl.reports.figures import comparison_figures, measurement_figures
from rigctl.reports.figures.scene_figures import light_figure
from rigctl.reports.report import Block, Bullets, Paragraph, Picture, Report, Section, Verbatim, Verdict
from rigctl.reports.tables import comparison_tables
from rigctl.reports.tables.annotation_tables import annotation_sections
from rigctl.reports.tables.comparison_tables import fault_table, fitted_table, move_table, parameter_table
from rigctl.reports.tables.effects_tables import taken_table
from rigctl.reports.tables.light_tables import share_table
from rigctl.reports.tables.numbers_json import STATISTICS
from rigctl.reports.tables.prediction_tables import detection_table, strength_table
from rigctl.reports.tables.provenance import provenance_json, source_table
from rigctl.reports.tables.row_table import mixed_row_table, row_table

# So many disagreements are shown at the head of the report; all stand in its tables.
_SHOWN_DISAGREEMENTS = 12
_SOURCE = (
    "Model ([MK14]: Meng & Kerekes, IEEE TGRS 2014, doi:10.1109/TGRS.2014.2299272) beside measurement. {kind} "
    "comparison. {origin}"
)
_SIMULATED = "The frames are simulated; the numbers of the simulated sensor and scene are assumed."


def comparison_report(comparison: Comparison) -> Report:
    """Return the report of a comparison."""
    measurement = comparison.measurement
    simulated = measurement.run.session.origin == "simulated"
    return Report(
        title=f"{measurement.run.path.name} beside the model",
        source=_SOURCE.format(kind=comparison.kind.capitalize(), origin=_SIMULATED if simulated else ""),
        verdict=Verdict(good=comparison.agrees is True, text=verdict(comparison), reasons=tuple(_reasons(comparison))),
        sections=[
            *_first(comparison, measurement),
            *annotation_sections(measurement.run.annotations),
            *_attributed(comparison.attribution),
            _pictures(measurement, comparison.outlines),
            *_both_sides(comparison, measurement),
            *_trends(comparison),
            *([light_section(comparison.lights)] if comparison.lights else []),
            *_uncertainty(comparison),
            *_effects(comparison.effects),
            *_by_itself(comparison),
            *_strength(comparison),
            *_numbers(comparison, measurement),
            *_limits(comparison),
            *_calibration(comparison.noise),
            *_sources(comparison),
        ],
    )


def verdict(comparison: Comparison) -> str:
    """Return the verdict in a sentence, with what it is held with."""
    found = comparison.verdict
    held_with = reservations(comparison.checks, comparison.regions)
    flagged = f" {held_with[:1].upper()}{held_with[1:]}." if held_with else ""
    if found == "cannot_be_judged":
        return f"{not_judged(comparison.checks).capitalize()}.{flagged}"
    if not any(row.agrees is not None for row in comparison.rows):
        return f"Nothing was tested.{flagged}"
    return f"Model and measurement {VERDICT_WORDS[found].lower()}.{flagged}"


def _reasons(comparison: Comparison) -> Iterable[tuple[str, str]]:
    for refusal in refusals(comparison.checks):
        yield "Refused:", refusal
    for line in unjudged_lines(comparison.regions, comparison.checks):
        yield "", line
    for weak in comparison.weak:
        yield "Hardly tested:", weak
    tests = sum(row.agrees is not None for row in comparison.rows)
    alpha = f"{comparison.alpha:g}"
    rule = (
        f"{tests} numbers were tested; {len(comparison.disagreements)} disagree. Holm's rule at alpha = {alpha}: if "
        f"all agree in truth, the chance that any one is called a disagreement is at most {alpha}."
    )
    yield "", rule
    for cause, advice in zip(comparison.diagnosis.points_to, comparison.diagnosis.advice, strict=True):
        yield f"Points to {cause}:", advice
    if comparison.attribution is not None and comparison.disagreements:
        yield "What would explain it:", comparison.attribution.remark + "."
    for title, text in said_of(comparison.checks, "flagged"):
        yield f"{title[:1].upper()}{title[1:]}:", text


def _first(comparison: Comparison, measurement: Measurement) -> Iterable[Section]:
    yield Section(title="In short", blocks=(comparison_tables.summary_table(comparison, measurement),))
    if comparison.disagreements:
        worst = comparison_tables.disagreeing(comparison, _SHOWN_DISAGREEMENTS)
        text = f"The {len(worst)} farthest of {len(comparison.disagreements)}; all stand in the tables below."
        table = mixed_row_table(worst)
        yield Section(title="What disagrees", blocks=(table, Paragraph(text=text)))


def _attributed(attribution: InputAttribution | None) -> Iterable[Section]:
    if attribution is None:
        return
    all_of_it = (
        f"chi-square of the residuals {attribution.chi_square:.1f} with {attribution.degrees_of_freedom} degrees of "
        f"freedom, {p_value(attribution.p_value)}, in the errors of measurement and inputs together"
    )
    method = Paragraph(
        text=f"{attribution.remark[:1].upper()}{attribution.remark[1:]} ({all_of_it}). For each input alone: how far "
        "it would have to move, in its own standard uncertainties, to remove what it can of the residuals; the score, "
        "standard normal where nothing is wrong; the chance of what is left; the share of its stated variance that "
        "these data resolve; and the inputs that they cannot tell from it were it off by five standard uncertainties."
    )
    blocks: tuple[Block, ...] = (method,)
    if attribution.moves:
        blocks += (move_table(attribution),)
    if attribution.unseen:
        blocks += (Paragraph(text="The data say nothing of: " + ", ".join(attribution.unseen) + "."),)
    yield Section(title="What would explain the residuals", blocks=blocks)
    fitted = Paragraph(
        text="FITTED to this run, not measured otherwise: all inputs updated at once (Bayesian linear update), each "
        "held by its stated uncertainty. Not for a comparison with the run that they were fitted to."
    )
    yield Section(title="Inputs fitted to this run", blocks=(fitted, fitted_table(attribution)), folded=True)


def _pictures(measurement: Measurement, regions: Sequence[Region]) -> Section:
    pictures = Picture(
        png=measurement_figures.scene_pictures(measurement.images, regions, unit=measurement.grid.unit),
        caption="Panchromatic and DoLP image with the regions (compare [MK14] Fig. 6).",
    )
    if measurement.images.residual is None:
        return Section(title="Pictures", blocks=(pictures,))
    residual = Picture(
        png=measurement_figures.residual_picture(measurement.images.residual),
        caption="What no light gives: twice the residual of the fit over the light, at 0, 45, 90, 135 deg what the "
        "sums of orthogonal pairs differ by. Structure in it is a fault of the run.",
    )
    return Section(title="Pictures", blocks=(pictures, residual))


def _both_sides(comparison: Comparison, measurement: Measurement) -> Iterable[Section]:
    if not comparison.predictions:
        return
    if any(row.z is not None for row in comparison.rows):
        scores = Picture(
            png=comparison_figures.scores(comparison),
            caption="Each tested number of a region: difference over the standard error of both sides. Numbers of one "
            "region share pixels and inputs and are not independent.",
        )
        yield Section(title="Standard scores", blocks=(scores,))
    bars = Picture(
        png=comparison_figures.channel_bars(comparison.rows, unit=measurement.grid.unit),
        caption="Mean and deviation of the counts behind each polarizer angle (compare [MK14] Fig. 7). Error bars: one "
        "standard error of both sides.",
    )
    yield Section(title="Counts by channel", blocks=(bars,))
    laws = Picture(
        png=comparison_figures.histograms(measurement, comparison.predictions),
        caption="Pixels of one cycle, and the exact laws that the model predicts (compare [MK14] Fig. 8).",
    )
    yield Section(title="Histograms", blocks=(laws,))


def _trends(comparison: Comparison) -> Iterable[Section]:
    if comparison.trends:
        note = Paragraph(
            text="Order of numbers, whatever their scale. A pair is known where it differs by more than two standard "
            "errors on both sides; the trend is predicted where every known pair is in order. The chance is that of so "
            "good an order by accident: few numbers make weak evidence."
        )
        yield Section(title="Trends", blocks=(comparison_tables.trend_table(comparison.trends), note))


def _uncertainty(comparison: Comparison) -> Iterable[Section]:
    known = [found for found in comparison.budgets if found.parts]
    if not known:
        return
    picture = Picture(
        png=comparison_figures.budget_bars(known),
        caption="Standard uncertainty of each region's mean by cause, to first order; the bar on top is all of them "
        "together. S0 as a share of itself.",
    )
    yield Section(
        title="Uncertainty budget",
        blocks=(picture, Paragraph(text="Of DoLP, in numbers:"), comparison_tables.budget_table(known, "dolp")),
    )


def _effects(effects: EffectsTaken | None) -> Iterable[Section]:
    if effects is None:
        return
    note = Paragraph(
        text="The most that leaving an effect out can change: of DoLP, s1 and s2 absolute, of the counts relative. "
        "Called for: whether leaving it out could cost more than half of the numerical tolerance. A comparison takes "
        "every effect behind the lens, and those of the light that are called for, but for what somebody left out by "
        "request (rigctl effects, --without)."
    )
    yield Section(title="Effects taken and skipped", blocks=(taken_table(effects), note))


def _by_itself(comparison: Comparison) -> Iterable[Section]:
    blocks: tuple[Block, ...] = (comparison_tables.check_table(comparison.checks),)
    found = comparison.run_diagnosis
    if found is not None and found.terms:
        blocks += (
            Paragraph(
                text="What more than three angles leave over, fitted by every fault at once; those that explain it "
                f"best stand first. {UNSEEN[:1].upper()}{UNSEEN[1:]}."
            ),
            fault_table(found.terms),
        )
    yield Section(title="The run by itself", blocks=blocks)


def _strength(comparison: Comparison) -> Iterable[Section]:
    performance = comparison.performance
    strength = Paragraph(
        text="By the model, for single pixels of one cycle: quantiles of DoLP by its exact law; how mean and deviation "
        "of DoLP were found and the error of that by its own estimate; NEDoLP, the deviation of DoLP that unpolarised "
        "light of this intensity would show by temporal noise."
    )
    blocks: tuple[Block, ...] = (strength, strength_table(comparison.predictions, performance))
    if any(found is not None and found.nedolp is None for found in performance.strengths.values()):
        blocks += (Paragraph(text=f"NEDoLP is not known: {NO_NOISE}."),)
    detection = detection_table(performance)
    if detection.rows:
        text = (
            "Probability of detection by RX on Stokes parameters ([MK14] eq. 30), exact law, at a probability of false "
            "alarm of:"
        )
        blocks += (Paragraph(text=text), detection)
    yield Section(title="Strength of polarization, and detection", blocks=blocks)


def _numbers(comparison: Comparison, measurement: Measurement) -> Iterable[Section]:
    meanings = "; ".join(f"{name}: {text}" for name, text in STATISTICS.items())
    yield Section(
        title="All numbers",
        blocks=(
            Paragraph(
                text=f"Counts and Stokes parameters in {measurement.grid.unit}, dark level taken off. ratio_ANGLE: "
                f"counts behind an angle over the mean of all. Deviations: {meanings}. Rows without a verdict are no "
                "tests: their prediction was made from this very number."
            ),
        ),
    )
    for name in measurement.regions:
        rows = [row for row in comparison.rows if row.region == name]
        yield Section(title=f"Numbers of {name}", blocks=(row_table(rows),), folded=True)


def _limits(comparison: Comparison) -> Iterable[Section]:
    yield Section(title="What this does not test", blocks=(Bullets(items=comparison.not_tested),))
    if comparison.remarks:
        yield Section(title="Assumed, overruled, left out", blocks=(Bullets(items=comparison.remarks),))


def _calibration(noise: NoiseParameters | None) -> Iterable[Section]:
    if noise is not None:
        yield Section(title="Calibration used", blocks=(parameter_table(noise),))


def _sources(comparison: Comparison) -> Iterable[Section]:
    yield Section(title="Where it comes from", blocks=(source_table(comparison),))
    provenance = Verbatim(text=json.dumps(provenance_json(comparison), indent=2))
    yield Section(title="Provenance in full", blocks=(provenance,), folded=True, printed=False)


def light_section(lights: Mapping[str, FieldLight]) -> Section:
    """Return the section on what the light of regions is made of.

    Parameters
    ----------
    lights : mapping
        Region to its light, as `rigctl.scene.scene_light.SceneLight.region` gives it; one or more.
    """
    text = (
        "Radiance at the aperture in W m-2 sr-1 in band, as the model has it: S1 = horizontal - vertical, S2 = (+45) - "
        "(-45). Reflected light is what is left of it at the camera; path is light that the air before the target adds."
    )
    picture = Picture(
        png=light_figure(lights), caption="What the light at the aperture is made of; the stroke is the total."
    )
    return Section(title="What the light is made of", blocks=(Paragraph(text=text), share_table(lights), picture))
