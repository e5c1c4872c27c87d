"""The joint fit of all faults of a run to what its redundant angles leave over."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.processing.diagnosis.causes import PER_FRAME, SHARED, Cause, parameter_count
from model.processing.diagnosis.correction import corrected_pictures, corrected_system, frame_faults
from model.processing.diagnosis.evidence import Evidence, by_size, estimates, significances
from model.processing.diagnosis.rounding import RoundedParts, rounded_parts
from model.processing.diagnosis.samples import block_samples, usable_with_neighbours
from model.processing.diagnosis.scores import Scores, score_covariance, tile_scores
from model.processing.diagnosis.weigher import Weigher, best_set, larger_set, stand_ins
from model.processing.reconstruction import design_from_system

FloatArray = NDArray[np.float64]

# Chance of finding anything where nothing is wrong.
FALSE_FINDING_RATE = 0.01
# Of the regressor of a curved response, root mean square, that is left after throughputs, angles and dark levels.
LEAST_SHARE_LEFT = 0.05
# What fine structure between pixels feigns as a curved response (standard deviation).
_RESPONSE_FLOOR = 0.01
# Of the information of a throughput: less is what numbers of a computer round.
_NUMBERS = 1e-13
# Of the variance that weights allow scores: pictures without any noise leave what numbers of a computer round.
_LEAST_SCATTER = 1e-6
_PASSES, _ROUNDS, _MOST_CAUSES, _LEAST_TILES = 8, 4, 6, 12
# Loss of evidence (natural logarithm) up to which other causes could stand in place of those named: one in a hundred.
CONFUSED_MARGIN = 4.6
# Gain of evidence (natural logarithm) below which causes are not exchanged for others once they were taken out.
_HARDLY_BETTER = 3.0
# Times the chance of the first cause that others may have: something is wrong, and the question is what.
_MORE_LENIENT = 5.0
# Last steps of a fit are below this share of a standard error.
_SETTLED = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class JointFit:
    """What a run says of its faults, about those that explain it best.

    Attributes
    ----------
    evidence
        Of all causes.
    weigher
        Of sets of them.
    candidates
        Numbers of the causes that this run can show.
    named
        Numbers of the causes that explain the run best, the strongest first.
    stand_ins
        Of each of them: which could stand in its place, alone or with others.
    parameters : (P,) array
        Of single frames and the response, as the named causes make them.
    light
        Mean counts, to which a curved response refers [DN].
    """

    evidence: Evidence
    weigher: Weigher
    candidates: NDArray[np.intp]
    named: tuple[int, ...]
    stand_ins: dict[int, set[int]]
    parameters: FloatArray
    light: float


def fit_faults(
    system: FloatArray,
    pictures: FloatArray,
    usable: NDArray[np.bool_],
    causes: tuple[Cause, ...],
    *,
    light: float,
    step: float = 0.0,
) -> JointFit | None:
    """Return the faults that explain best what redundant angles leave over; None where too few pixels are usable.

    Parameters
    ----------
    system
        Rows of the frames, shape (N, 3), N > 3.
    pictures
        Counts, dark level taken off, shape (N, H, W) [DN].
    usable
        Pixels that are neither missing nor clipped in any frame, shape (H, W).
    causes
        That are looked for.
    light
        Mean counts [DN].
    step
        Of the rounding of the pictures [DN]; 0 where none is known.

    Notes
    -----
    Gauss and Newton: faults found are taken out of the pictures and the design, and the fit is made about them, until
    neither the set nor its sizes change.
    """
    near = usable_with_neighbours(usable)
    parts = rounded_parts(pictures, usable, null_basis=design_from_system(system).null_basis, step=step)
    parameters = np.zeros(parameter_count(len(pictures)))
    named: tuple[int, ...] | None = None
    for _ in range(_PASSES):
        scores = _scores_about(system, pictures, near, parameters, light, parts)
        if scores.tiles < _LEAST_TILES:
            return None
        fit = _fit_about(scores, parameters, causes, light, named or ())
        settled = fit.named == named and _is_settled(fit, parameters)
        before, named, parameters = named or (), fit.named, fit.parameters
        if settled or not named:
            break
    return _with_twins(fit, before)


def _with_twins(fit: JointFit, before: tuple[int, ...]) -> JointFit:
    """Return a fit whose causes cannot be told from those of the pass before, where these are others.

    Notes
    -----
    Sets that follow one another, each the best once the other was taken out, are the same to a run.
    """
    same = {index: set(others) for index, others in fit.stand_ins.items()}
    for twin in set(before) - set(fit.named) if fit.named else ():
        same[max(fit.named, key=lambda index: fit.weigher.correlation(index, twin))].add(twin)
    return replace(fit, stand_ins=same)


def share_left(evidence: Evidence, index: int) -> float:
    """Return what is left of the regressor of a cause after throughputs, angles and dark levels, root mean square."""
    information = 0.5 * (evidence.information + evidence.information.T)
    count = (len(information) - len(SHARED)) // len(PER_FRAME) * 3
    direction = evidence.causes[index].directions[:, 0]
    own = float(direction @ information @ direction)
    size = np.sqrt(np.maximum(np.diag(information)[:count], 0.0))
    held = size > 0.0
    if not held.any() or not own > _NUMBERS * float(size.max()) ** 2:
        return 0.0
    others = information[:count, :count][np.ix_(held, held)] / np.outer(size[held], size[held])
    cross = (information[:count] @ direction)[held] / size[held]
    values, vectors = np.linalg.eigh(others)
    kept = values > 1e-7
    along = vectors[:, kept].T @ cross
    return float(np.sqrt(max(0.0, 1.0 - float(np.sum(along**2 / values[kept])) / own)))


def _scores_about(
    system: FloatArray,
    pictures: FloatArray,
    near: NDArray[np.bool_],
    parameters: FloatArray,
    light: float,
    parts: RoundedParts | None,
) -> Scores:
    faults = frame_faults(parameters, len(pictures))
    design, turned = corrected_system(system, faults)
    straight = corrected_pictures(pictures, faults, light=light)
    samples = block_samples(design, turned, straight, near, faults=faults, light=light)
    return tile_scores(design.null_basis, samples, parts)


def _fit_about(
    scores: Scores,
    parameters: FloatArray,
    causes: tuple[Cause, ...],
    light: float,
    before: tuple[int, ...],
) -> JointFit:
    """Return the fit, with errors from what is left once the causes that it names are taken out.

    Notes
    -----
    Causes that were named before stay where others explain the run hardly better: twins would follow one another.
    """
    sums = _Sums(scores=scores, parameters=parameters, causes=causes)
    evidence = sums.evidence_about(sums.everything(), ())
    left_out: set[int] = set()
    while True:
        evidence, candidates, best = _best_causes(sums, evidence, left_out, before)
        evidence, best = _with_its_own_errors(sums, evidence, np.setdiff1d(candidates, [*left_out]), best)
        evidence, named = _that_stand(sums, evidence, best, FALSE_FINDING_RATE / max(len(candidates), 1))
        if named or not best:
            break
        # What does not stand by itself must not stand in the way of what does.
        left_out |= set(best)
    weigher = Weigher(evidence)
    return JointFit(
        evidence=evidence,
        weigher=weigher,
        candidates=candidates,
        named=by_size(evidence, named),
        # A response that polarization is too alike to test may be what is wrong all the same.
        stand_ins=stand_ins(weigher, named, np.arange(len(causes)), margin=CONFUSED_MARGIN),
        parameters=_sum_of(evidence, named),
        light=light,
    )


def _best_causes(
    sums: "_Sums", evidence: Evidence, left_out: set[int], kept: tuple[int, ...]
) -> tuple[Evidence, NDArray[np.intp], tuple[int, ...]]:
    """Return the causes that explain a run best, some left out, with the errors that are left about them."""
    named: tuple[int, ...] | None = None
    for _ in range(_ROUNDS):
        candidates, weigher = _candidates(evidence), Weigher(evidence)
        before, named = named, best_set(weigher, np.setdiff1d(candidates, [*left_out]), most=_MOST_CAUSES)
        if kept and not left_out & set(kept):
            gained = weigher.log_evidence(named) - weigher.log_evidence(kept)
            named = kept if gained < _HARDLY_BETTER else named
        if named == before:
            break
        evidence = sums.evidence_of(named)
    return evidence, candidates, named or ()


def _with_its_own_errors(
    sums: "_Sums", evidence: Evidence, candidates: NDArray[np.intp], named: tuple[int, ...]
) -> tuple[Evidence, tuple[int, ...]]:
    """Return a larger set where it explains a run better by the errors that it leaves itself.

    Notes
    -----
    The errors about a set hold what the set leaves unexplained, and so speak for it.
    """
    larger = larger_set(Weigher(evidence), candidates, named)
    if len(larger) > _MOST_CAUSES or larger == named:
        return evidence, named
    about = sums.evidence_of(larger)
    weigher = Weigher(about)
    is_better = weigher.log_evidence(larger) > weigher.log_evidence(named)
    return (about, larger) if is_better else (evidence, named)


def _that_stand(
    sums: "_Sums", evidence: Evidence, named: tuple[int, ...], level: float
) -> tuple[Evidence, tuple[int, ...]]:
    """Return the causes left when the least significant is taken away, one after the other, with errors about them."""
    while named:
        chances = significances(evidence, named)
        worst = int(np.argmax(chances))
        if min(chances) <= level and chances[worst] <= (_MORE_LENIENT * level if len(named) > 1 else level):
            break
        named = named[:worst] + named[worst + 1 :]
        evidence = sums.evidence_of(named)
    return evidence, named


class _Sums:
    """Sums over tiles, made about some parameters, and the evidence that they are."""

    def __init__(self, *, scores: Scores, parameters: FloatArray, causes: tuple[Cause, ...]) -> None:
        self._scores, self._parameters, self._causes = scores, parameters, causes
        self.information = scores.information.sum(axis=0)
        self.right = scores.right.sum(axis=0) + self.information @ parameters
        self._unseen = _unseen(self.information) + scores.rounding_covariance

    def evidence_of(self, chosen: tuple[int, ...]) -> Evidence:
        """Return the evidence with the scatter of what some causes leave at their best sizes."""
        return self.evidence_about(_sum_of(self._evidence(self._unseen, 1.0), chosen), chosen)

    def everything(self) -> FloatArray:
        """Return the sizes of all faults at once."""
        return _everything(self._causes, self.information, self.right, self._scores.expected_covariance + self._unseen)

    def evidence_about(self, about: FloatArray, fitted: tuple[int, ...]) -> Evidence:
        """Return the evidence with the scatter of what faults of a known size leave, some of them fitted."""
        directions = [self._causes[index].directions for index in fitted]
        nothing = np.zeros((len(self.right), 0))
        scattered = score_covariance(self._scores, about - self._parameters, np.hstack([nothing, *directions]))
        return self._evidence(scattered.covariance + self._unseen, scattered.freedom)

    def _evidence(self, covariance: FloatArray, freedom: float) -> Evidence:
        return Evidence(
            causes=self._causes,
            information=self.information,
            covariance=covariance,
            right=self.right,
            freedom=freedom,
        )


def _unseen(information: FloatArray) -> FloatArray:
    """Return the covariance of scores by what feigns a curved response, and by the rounding of numbers."""
    feigned = information[:, -len(SHARED) :] * _RESPONSE_FLOOR
    return np.asarray(feigned @ feigned.T + np.diag(_LEAST_SCATTER * np.abs(np.diag(information))))


def _candidates(evidence: Evidence) -> NDArray[np.intp]:
    testable = [
        index
        for index, cause in enumerate(evidence.causes)
        if cause.name not in SHARED or share_left(evidence, index) > LEAST_SHARE_LEFT
    ]
    return np.array(testable, dtype=np.intp)


def _everything(causes: tuple[Cause, ...], information: FloatArray, right: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the sizes of all faults at once, each held by what is expected of rigs, and by the noise of the scores.

    Notes
    -----
    The information of shifts is less than their noise, and in some directions nothing: it cannot stand for that noise.
    """
    expected = np.column_stack([cause.directions * cause.expected for cause in causes])
    done = information @ expected
    size = np.sqrt(np.diag(noise + done @ done.T))
    size = np.where(size > 0.0, size, np.inf)
    scaled = (noise + done @ done.T) / np.outer(size, size)
    return np.asarray(expected @ (done.T @ (np.linalg.lstsq(scaled, right / size, rcond=None)[0] / size)))


def _sum_of(evidence: Evidence, chosen: tuple[int, ...]) -> FloatArray:
    total = np.zeros(len(evidence.right))
    if chosen:
        fitted = estimates(evidence, chosen)
        for index, part in zip(chosen, fitted.parts, strict=True):
            total += evidence.causes[index].directions @ fitted.values[part]
    return total


def _is_settled(fit: JointFit, before: FloatArray) -> bool:
    moved = fit.evidence.information @ (fit.parameters - before)
    return bool(np.all(np.abs(moved) <= _SETTLED * np.sqrt(np.diag(fit.evidence.covariance)) + 1e-300))
