"""References of the hard cases: what a case states, another solver of the sky, random draws; extended precision."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from model.prediction import RegionPrediction
from model.processing.detection import rx_p_detection, rx_p_miss
from model.processing.dolp import moments
from rigctl.files.choices import Engine
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor
from rigctl.scene.light import SceneLight, build_scenario
from rigctl.scene.scene import Scene
from tests.hard_cases.cases import HardCase
from tests.model.processing.dolp_reference import dolp_cases
from tests.model.processing.rx_reference import CASES, column
from tests.model.processing.rx_reference import moments as rx_moments

FloatArray = NDArray[np.float64]

TARGET, BACKGROUND = "black", "white"
P_FALSE_ALARM = 1e-3
# What sasktran2 does not do: it does not see nearer than 1 deg to the horizon, and needs a level for 0.01 of depth.
NO_SOLVER = {
    "view 89.9 deg": "sasktran2 is wrong nearer than 1 deg to the horizon; see the round earth",
    "view 89.99 deg": "sasktran2 is wrong nearer than 1 deg to the horizon; see the round earth",
    "aerosol of depth 50": "sasktran2 refuses the 5000 levels that it needs",
}
_LARGEST_CONDITION = 1e10
_DRAWS = 1_000_000
# Of a sum of a few products, each of double precision.
ROUNDING = 1e-14
# Below it a double has fewer digits, or none.
_LEAST = 1e-300


@dataclass(frozen=True, kw_only=True)
class Known:
    """A number of the reference, and its own error."""

    value: float
    error: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """What else says what a case is, and the light from which its run is drawn."""

    source: str  #: of DoLP: "stated", "sasktran2", or why there is none
    dolp: Known | None
    snr: Known | None
    p_detection: Known | None
    scene: Scene
    light: Mapping[str, tuple[FloatArray, FloatArray]]  #: mean and covariance of each region's Stokes radiance


def reference_of(case: HardCase, scene: Path) -> Reference:
    """Return the reference of a case.

    DoLP of a stated radiance is what is stated. That of a material has its sky solved by sasktran2, with the fast and
    with the standard settings of a scene: their difference is its own error. SNR and P_D are those of draws.
    """
    is_material = "material" in case.text
    if not is_material or case.name in NO_SOLVER:
        found, scenario, light = _lit(scene, "own", "standard")
        dolp = None if case.dolp is None else Known(value=case.dolp, error=ROUNDING * case.condition)
        source = NO_SOLVER.get(case.name, "stated")
    else:
        coarse, _, _ = _lit(scene, "sasktran2", "fast")
        found, scenario, light = _lit(scene, "sasktran2", "standard")
        one, other = (each[TARGET].quantities["dolp"]["mean"] for each in (coarse, found))
        dolp, source = Known(value=other, error=abs(other - one)), "sasktran2"
    snr, p_detection = _by_draws(found, seed=crc32(case.name.encode()))
    return Reference(source=source, dolp=dolp, snr=snr, p_detection=p_detection, scene=scenario, light=light)


def _lit(
    path: Path, engine: Engine, tier: str
) -> tuple[dict[str, RegionPrediction], Scene, dict[str, tuple[FloatArray, FloatArray]]]:
    """Return predictions, scene and light of a scene file, its sky solved by an engine with the settings of a tier."""
    finer = path.with_name("reference.toml")
    finer.write_text(path.read_text().replace('tier = "fast"', f'tier = "{tier}"'))
    light = SceneLight(engine=engine, is_kept_between_runs=engine == "own")
    predictor = ScenePredictor(load_scene(finer), None, light=light)
    scene = predictor.scene
    scenario = build_scenario(scene, light=light)
    at_aperture = {one.name: one.aperture_moments() for one in scenario.regions}
    by_name = {name: (moments.mean, moments.cov) for name, moments in at_aperture.items()}
    return predictor.predictions(), scene, by_name


def _by_draws(found: Mapping[str, RegionPrediction], *, seed: int) -> tuple[Known | None, Known | None]:
    """Return SNR of the target's DoLP, and the share of draws that a detector with the background's moments finds."""
    if "mean" not in found[TARGET].quantities.get("dolp_snr", {}):
        return None, None
    mean, cov = found[TARGET].stokes_dn.mean, found[TARGET].stokes_dn.cov
    sizes, axes = np.linalg.eigh(cov)
    drawn = np.random.default_rng(seed).standard_normal((_DRAWS, 3)) * np.sqrt(np.maximum(sizes, 0.0))
    stokes = mean + drawn @ axes.T
    dolp = np.hypot(stokes[:, 1], stokes[:, 2]) / stokes[:, 0]
    snr = float(dolp.mean() / dolp.std())
    # Of the deviation, by the kurtosis of the draws, and of the mean.
    of_std = np.sqrt((np.mean((dolp - dolp.mean()) ** 4) / dolp.var() ** 2 - 1.0) / (4.0 * _DRAWS))
    known = Known(value=snr, error=snr * float(np.hypot(of_std, 1.0 / (snr * np.sqrt(_DRAWS)))))
    law = found[BACKGROUND].stokes_dn
    if np.linalg.eigvalsh(law.cov)[0] <= 0.0 or np.linalg.cond(law.cov) > _LARGEST_CONDITION:
        return known, None
    off = stokes - law.mean
    distance = np.einsum("ni,ij,nj->n", off, np.linalg.inv(law.cov), off)
    share = float(np.mean(distance > chdtri(3.0, P_FALSE_ALARM)))
    # Of none or all of N draws the chance may still be 3 / N.
    error = max(float(np.sqrt(share * (1.0 - share) / _DRAWS)), 3.0 / _DRAWS)
    return known, Known(value=share, error=error)


_TEXT = """\
## Moments and probabilities in extended precision

Quadrature of 170 bits is the reference for {cases} laws of DoLP, at SNRs of S0 from 10 to 1e6. The largest relative
error of mean and deviation is {moments}. Two unrelated methods of 170 bits are the reference for {tails} tails of the
RX detector, each at the smallest probability that a double can represent, down to {least:.0e}. The largest relative
error is {probabilities}, for a background of condition number 1e10."""


def reference_text() -> str:
    """Return the largest errors against extended precision."""
    laws, tails = list(dolp_cases(with_moments=True)), [one for case in CASES.values() for one in _tails(case)]
    return _TEXT.format(
        cases=len(laws),
        moments=_apart(max(map(_of_dolp, laws))),
        tails=len(tails),
        least=min(truth for truth, _ in tails),
        probabilities=_apart(max(abs(ours / truth - 1.0) for truth, ours in tails)),
    )


def _of_dolp(case: dict[str, object]) -> float:
    """Return the larger relative error of mean and deviation."""
    found = moments(np.array(case["stokes"]), np.array(case["cov"]), tolerance=1e-12)
    mean, std = float(str(case["mean"])), float(str(case["std"]))
    return max(abs(float(found.mean) / mean - 1.0), abs(float(found.std) / std - 1.0))


def _tails(case: dict[str, object]) -> Iterator[tuple[float, float]]:
    """Yield for each tail the smallest probability that a double can represent, by the reference and by ours."""
    target_mean, target_cov, mean, cov = rx_moments(case)
    pfa = column(case, "pfa")
    for name, function in (("pd", rx_p_detection), ("pmiss", rx_p_miss)):
        truth = column(case, name)
        there = np.flatnonzero(truth > _LEAST)
        if there.size:
            least = int(there[np.argmin(truth[there])])
            yield (
                float(truth[least]),
                float(np.asarray(function(pfa[least], target_mean, target_cov, mean, cov))),
            )


def _apart(error: float) -> str:
    """Return a relative error as text that is the same on every machine, without digits of rounding."""
    return "below 1e-12" if error < 1e-12 else f"{error:.0e}"
