"""What runs say of the inputs of a scene: from measured regions and a scene to the posterior of its uncertain numbers.

Of every region ln S0, S1/S0 and S2/S0 are compared, with the covariance of the run's mean counts. Chosen inputs are
inferred; all other uncertain inputs of the scene widen the covariance, to first order. Numerical settings are those of
a stated tolerance, and their errors are part of the covariance too.

The model's discrepancy has two scales, of ln S0 and of polarization. It is a smooth function of the directions of sun
and camera over the panel, so that many runs in nearly one geometry do not average it away; half of its variance is
common to all regions, since they share the equations. Regions given by their radiance have none.
"""

import hashlib
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.moments import propagate_linear
from model.processing import posterior as bayes
from model.processing.posterior import Posterior, Problem
from model.stokes import rotation
from model.surface.pbrdf import Tilt, local_geometry
from rigctl.base.arrays import read_arrays
from rigctl.base.durable import write_durably
from rigctl.calibrations.radiometric import RadiometricResponse
from rigctl.comparison.checks import not_judged, refused_regions, registration_of, run_checks, titles, verdict_of
from rigctl.comparison.compare import NumericalAccuracy, accuracy_at
from rigctl.comparison.predict_run import RunPredictor, run_predictor
from rigctl.comparison.scale import panel_scaled, without_throughput
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import ScaleKind
from rigctl.mapped import code_version
from rigctl.measure.diagnose import DiagnosedRun
from rigctl.scene.light import SceneLight, camera_view, sun_azimuth_rad
from rigctl.scene.scene import Parameter, Scene, get, only_uncertain

FloatArray = NDArray[np.float64]

QUANTITIES = ("ln_s0", "s1n", "s2n")
# Prior median of the discrepancy of ln S0 over that of S1/S0 and S2/S0.
RADIANCE_SHARE = 5.0
# Directions of sun or camera that differ by so much have half-independent discrepancies [rad].
_SMOOTH_RAD = 0.5
# Share of the discrepancy's variance that all regions have in common.
_COMMON = 0.5
# A numerical error of this share of the discrepancy changes nothing; between these limits.
_NUMERICAL_SHARE, _FINEST, _COARSEST = 0.1, 3e-4, 3e-3
# An input of which the runs resolve less of its variance is not inferred, unless it was chosen.
_LEAST_RESOLVED = 0.05
# Deviation of ln S0 where the scale of the counts is free.
_ANY_SCALE = 10.0
_PACKAGES = ("model", "rigctl.files", "rigctl.scene", "rigctl.comparison")


@dataclass(frozen=True, kw_only=True, eq=False)
class PanelGeometry:
    """Directions over a panel, its normal upwards and the camera's azimuth 0."""

    sun: FloatArray  #: unit vectors
    camera: FloatArray
    turn: FloatArray  #: takes (S1, S2) from the panel's axes to the camera's, shape (2, 2)

    def likeness(self, other: "PanelGeometry", *, mirrored: bool = False) -> float:
        """Return how much a smooth function of both directions has in common at two geometries, 0 to 1."""
        sun = other.sun * (1.0, -1.0, 1.0) if mirrored else other.sun
        apart = np.sum((self.sun - sun) ** 2) + np.sum((self.camera - other.camera) ** 2)
        return float(np.exp(-0.5 * apart / _SMOOTH_RAD**2))


@dataclass(frozen=True, kw_only=True, eq=False)
class RegionNumbers:
    """Three numbers of one region of one run, and where they stand among the data."""

    run: str
    region: str
    place: int
    geometry: PanelGeometry | None  #: None where the radiance is given

    @property
    def rows(self) -> NDArray[np.intp]:
        """Positions among the data."""
        return np.arange(3 * self.place, 3 * self.place + 3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Runs and a scene, ready to be inferred from."""

    runs: tuple[str, ...]
    parameters: tuple[Parameter, ...]  #: inferred inputs, with the prior of the scene
    problem: Problem
    numbers: tuple[RegionNumbers, ...]
    untaught: tuple[str, ...]  #: uncertain inputs that the runs say next to nothing of
    remarks: tuple[str, ...]
    scene: Scene
    digest: str  #: of data, scene, choices and code


@dataclass(frozen=True, kw_only=True, eq=False)
class Inference:
    """Posterior of the inputs of a scene."""

    evidence: Evidence
    posterior: Posterior

    @cached_property
    def p_values(self) -> FloatArray:
        """Posterior predictive chance of each region's numbers, shape (regions,)."""
        return self._chances(discrepancy=True)

    @cached_property
    def p_values_of_model(self) -> FloatArray:
        """The same as if the model had no discrepancy."""
        return self._chances(discrepancy=False)

    @cached_property
    def discrepancy(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of the discrepancy, shape (regions, 3) each."""
        mean, std = bayes.discrepancy_moments(self.evidence.problem, self.posterior)
        return mean.reshape(-1, 3), std.reshape(-1, 3)

    @property
    def indistinguishable(self) -> tuple[tuple[str, ...], ...]:
        """Groups of inputs of which only a combination is known."""
        return tuple(tuple(self.evidence.parameters[k].key for k in group) for group in self.posterior.together)

    def _chances(self, *, discrepancy: bool) -> FloatArray:
        blocks = [one.rows for one in self.evidence.numbers]
        return bayes.block_p_values(self.evidence.problem, self.posterior, blocks, discrepancy=discrepancy)


class FolderStore:
    """Keeps points and blocks of a chain in a folder, under the hash of what they follow from."""

    def __init__(self, folder: Path, digest: str) -> None:
        self._folder, self._digest = folder, digest

    def load(self, name: str) -> bayes.Arrays | None:
        """Return what was saved under a name; None where nothing was, or it is damaged."""
        try:
            return read_arrays(self._path(name))
        except DataError:
            return None

    def save(self, name: str, arrays: bayes.Arrays) -> None:
        """Return once the arrays are on the disk."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        write_durably(self._path(name), buffer.getvalue())

    def _path(self, name: str) -> Path:
        return self._folder / f"{self._digest}-{name}.npz"


def gather_evidence(
    seen: Sequence[DiagnosedRun],
    scenes: Sequence[Scene],
    *,
    chosen: Sequence[str] = (),
    scale: ScaleKind = "absolute",
    radiometric: RadiometricResponse | None = None,
    discrepancy: float = 0.02,
) -> Evidence:
    """Return what runs of a scene say of its inputs; `scenes` is the scene with the noise calibration of each run."""
    runs = [
        _Run(one, scene, scale=scale, radiometric=radiometric, discrepancy=discrepancy)
        for one, scene in zip(seen, scenes, strict=True)
    ]
    used = [run for run in runs if run.regions]
    if not used:
        raise DataError("no region of any run can be used: " + "; ".join(one for run in runs for one in run.remarks))
    joint = _Joint(used)
    slopes = joint.slopes()
    kept, rest = _split(joint, slopes, chosen, discrepancy)
    inputs = joint.inputs
    digest = hashlib.sha256(repr([chosen, scale, discrepancy, code_version(_PACKAGES)]).encode())
    for run in used:
        digest.update(repr(run.inputs.scene).encode() + run.numbers.tobytes() + run.cov.tobytes())
    return Evidence(
        runs=tuple(run.name for run in used),
        parameters=tuple(get(inputs.scene, inputs.names[k]) for k in kept),
        problem=joint.problem(kept, rest, slopes, discrepancy),
        numbers=joint.numbers,
        untaught=tuple(inputs.names[k] for k in rest),
        remarks=tuple(dict.fromkeys(remark for run in runs for remark in run.remarks)),
        scene=inputs.scene,
        digest=digest.hexdigest()[:12],
    )


def infer_inputs(
    evidence: Evidence,
    *,
    seed: int = 1,
    most_steps: int = 20_000,
    folder: Path | None = None,
    tell: Callable[[str, int, int], None] = lambda *_: None,
) -> Inference:
    """Return the posterior of the inputs; points and chain are kept in a folder, where the same call goes on."""
    if find_spec("emcee") is None:
        raise ConfigError("rigctl infer needs emcee: pip install 'rigctl[infer]'")
    store = bayes.Memory() if folder is None else FolderStore(folder, f"{evidence.digest}-{seed}")
    try:
        found = bayes.infer(evidence.problem, seed=seed, most_steps=most_steps, store=store, tell=tell)
    except bayes.NotConvergedError as error:
        again = "" if folder is None else f"; what was computed is kept in {folder}, and the same command goes on"
        raise DataError(f"{error}{again}") from error
    return Inference(evidence=evidence, posterior=found)


def _split(
    joint: "_Joint", slopes: FloatArray, chosen: Sequence[str], discrepancy: float
) -> tuple[list[int], list[int]]:
    """Return which uncertain inputs are inferred, and which are not: those of which the runs say next to nothing."""
    names = joint.inputs.names
    unknown = [key for key in chosen if key not in names]
    if unknown:
        get(joint.inputs.scene, unknown[0])  # says which keys there are
        raise ConfigError(f"--input: {', '.join(unknown)} has no std in the scene file; the prior needs one")
    if chosen:
        kept = [k for k, name in enumerate(names) if name in chosen]
    else:
        whole = joint.problem(list(range(len(names))), [], slopes, discrepancy)
        cov = whole.total_cov(np.asarray(whole.discrepancy_median))
        update = bayes.linear_update(slopes @ whole.root, np.zeros(len(whole.data)), cov)
        std = np.sqrt(np.diag(whole.root @ update.cov @ whole.root.T) / np.diag(whole.cov))
        kept = np.flatnonzero(std**2 < 1.0 - _LEAST_RESOLVED).tolist()
    if not kept:
        raise DataError("the runs say next to nothing of any uncertain input; give other inputs a std, or --input")
    return kept, [k for k in range(len(names)) if k not in kept]


class _Joint:
    """Several runs together: the same inputs are off by the same amount in all of them."""

    def __init__(self, runs: Sequence["_Run"]) -> None:
        self.runs = tuple(runs)
        self.inputs = only_uncertain(runs[0].inputs)
        if not self.inputs.names:
            raise ConfigError(
                f"scene {self.inputs.scene.name}: no number has an uncertainty, so that there is no prior; write "
                "{ value = ..., std = ... } or { range = [..., ...] }"
            )
        self._known: dict[bytes, FloatArray] = {}

    @property
    def numbers(self) -> tuple[RegionNumbers, ...]:
        """The regions of all runs, in the order of the data."""
        regions = [(run, name) for run in self.runs for name in run.regions]
        return tuple(
            RegionNumbers(run=run.name, region=name, place=k, geometry=run.geometry(name))
            for k, (run, name) in enumerate(regions)
        )

    def model(self, values: FloatArray) -> FloatArray:
        """Return the numbers of all runs at values of the uncertain inputs; ValueError if there is no model of them."""
        key = values.tobytes()
        if key not in self._known:
            self._known[key] = np.concatenate([self._of_run(run, values) for run in self.runs])
        return self._known[key]

    def _of_run(self, run: "_Run", values: FloatArray) -> FloatArray:
        moved = run.inputs.values.copy()
        for name, move in zip(self.inputs.names, values - self.inputs.values, strict=True):
            if name in run.inputs.names:
                moved[run.inputs.names.index(name)] += move
        return run.modelled(moved)

    def slopes(self) -> FloatArray:
        """Return the change of the numbers by each input, per unit of the input, shape (N, inputs)."""
        std = np.sqrt(np.diag(self.inputs.cov))
        centre = self.model(self.inputs.values)
        above, below = (np.array([self._beside(centre, k, side * std[k]) for k in range(std.size)]) for side in (1, -1))
        return bayes.central_slopes(centre, above, below) / std

    def _beside(self, centre: FloatArray, k: int, step: float) -> FloatArray:
        values = self.inputs.values.copy()
        values[k] += step
        if not self.inputs.least[k] <= values[k] <= self.inputs.most[k]:
            return np.full_like(centre, np.nan)
        try:
            return self.model(values)
        except ValueError:
            return np.full_like(centre, np.nan)

    def problem(self, kept: list[int], rest: list[int], slopes: FloatArray, discrepancy: float) -> Problem:
        """Return the problem of some inputs; the others widen the covariance, and follow what they go together with."""
        inputs, cov = self.inputs, self.inputs.cov
        own = cov[np.ix_(kept, kept)]
        along = cov[np.ix_(rest, kept)] @ np.linalg.inv(own)
        left = cov[np.ix_(rest, rest)] - along @ cov[np.ix_(kept, rest)]

        def model(values: FloatArray) -> FloatArray:
            whole = inputs.values.copy()
            whole[kept] = values
            whole[rest] += along @ (values - inputs.values[kept])
            return self.model(whole)

        noise = slopes[:, rest] @ left @ slopes[:, rest].T
        start = 0
        for run in self.runs:
            stop = start + run.numbers.size
            noise[start:stop, start:stop] += run.cov
            start = stop
        shapes = _discrepancy_shapes(self.numbers) if discrepancy > 0.0 else ()
        return Problem(
            mean=inputs.values[kept],
            cov=own,
            least=inputs.least[kept],
            most=inputs.most[kept],
            model=model,
            data=np.concatenate([run.numbers for run in self.runs]),
            noise_cov=noise,
            discrepancy=shapes,
            discrepancy_median=(RADIANCE_SHARE * discrepancy, discrepancy)[: len(shapes)],
        )


def _discrepancy_shapes(numbers: Sequence[RegionNumbers]) -> tuple[FloatArray, ...]:
    """Return the covariance of the discrepancy of ln S0 and of polarization for scales of 1; none without materials.

    In the axes of a panel S2 changes its sign with the azimuth of the sun, by symmetry, for any model and in nature: so
    does its discrepancy, which is 0 in the principal plane and says nothing there of that of S1.
    """
    if all(one.geometry is None for one in numbers):
        return ()
    size = 3 * len(numbers)
    radiance, polarization = np.zeros((size, size)), np.zeros((size, size))
    for one in numbers:
        for other in numbers:
            if one.geometry is None or other.geometry is None:
                continue
            share = 1.0 if one.region == other.region else _COMMON
            direct, across = (one.geometry.likeness(other.geometry, mirrored=side) for side in (False, True))
            radiance[one.rows[0], other.rows[0]] = share * direct
            of_panel = share * np.diag([direct, direct - across])
            polarization[np.ix_(one.rows[1:], other.rows[1:])] = one.geometry.turn @ of_panel @ other.geometry.turn.T
    return radiance, polarization


class _Run:
    """One run: its measured numbers with their covariance, and what the model says of them."""

    def __init__(
        self,
        seen: DiagnosedRun,
        scene: Scene,
        *,
        scale: ScaleKind,
        radiometric: RadiometricResponse | None,
        discrepancy: float,
    ) -> None:
        measurement = seen.measurement
        self.name = measurement.run.path.resolve().name
        checks = run_checks(measurement, registration_of(measurement), seen.diagnosis)
        if verdict_of((), checks, {}) == "cannot_be_judged":
            raise DataError(f"{measurement.run.path}: {not_judged(checks)}")
        refused = measurement.unmeasured | refused_regions(checks)
        self.remarks = [f"{self.name}: {name} left out: {why}" for name, why in refused.items()]
        self.remarks += [f"{self.name}: flagged: {name}" for name in filter(None, [titles(checks, "flagged")])]
        self.measurement = measurement
        stated = run_predictor(measurement, scene)
        self.regions = [
            region.name
            for region in stated.inputs.scene.regions
            if region.name in measurement.regions and region.name not in refused and self._has_light(region.name)
        ]
        if self.regions:
            self._take(stated, scale, radiometric, discrepancy)

    def _take(
        self, stated: RunPredictor, scale: ScaleKind, radiometric: RadiometricResponse | None, discrepancy: float
    ) -> None:
        tolerance = float(np.clip(_NUMERICAL_SHARE * discrepancy, _FINEST, _COARSEST))
        accuracy = accuracy_at(stated, tolerance, "safe")
        self.predictor = replace(
            stated.without(accuracy.left_out),
            settings=accuracy.found.result.settings,
            # Every point has a sky of its own, which no other command asks for.
            light=SceneLight(is_kept_between_runs=False),
        )
        inputs = self.predictor.inputs
        if scale == "free":
            inputs = without_throughput(inputs)
        if scale == "panel":
            if radiometric is None:
                raise ConfigError("--scale panel and --radiometric FILE (rigctl calibrate radiometric) go together")
            inputs = panel_scaled(inputs, radiometric, exposure_s=self.predictor.exposure_s)[0]
        self.inputs = inputs
        self.stokes, cov = self._measured()
        self.numbers = np.concatenate([_numbers(one) for one in self.stokes])
        self.cov = cov + np.diag(np.concatenate([self._numerical(accuracy, name) for name in self.regions]) ** 2)
        if scale == "free":
            shift = np.tile([_ANY_SCALE, 0.0, 0.0], len(self.regions))
            self.cov = self.cov + np.outer(shift, shift)
        self.remarks += [*self.predictor.remarks, *inputs.scene.remarks]

    def _has_light(self, region: str) -> bool:
        moments = propagate_linear(self.measurement.regions[region].channels_mean, self.measurement.plan.inverse)
        bright = bool(moments.mean[0] > _LEAST_SNR * np.sqrt(moments.cov[0, 0]))
        if not bright:
            self.remarks.append(f"{self.name}: {region} left out: its light is not above its error")
        return bright

    def _measured(self) -> tuple[FloatArray, FloatArray]:
        """Return Stokes parameters of the regions, and the covariance of their numbers."""
        measurement, inverse = self.measurement, self.measurement.plan.inverse
        level = measurement.dark_level.std_error_dn * measurement.grid.to_unit
        stokes = np.stack([inverse @ measurement.regions[name].channels_mean.mean for name in self.regions])
        slopes = [_slopes(one) @ inverse for one in stokes]
        cov = np.empty((3 * len(slopes),) * 2)
        for i, one in enumerate(self.regions):
            for j in range(len(slopes)):
                of_counts = measurement.regions[one].channels_mean.cov if i == j else np.outer(level, level)
                cov[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = slopes[i] @ of_counts @ slopes[j].T
        return stokes, cov

    def _numerical(self, accuracy: NumericalAccuracy, region: str) -> FloatArray:
        """Return the numerical errors of a region's numbers."""
        return np.array([accuracy.in_tolerance(region, quantity, "mean") for quantity in ("s0", "s1n", "s2n")])

    def modelled(self, values: FloatArray) -> FloatArray:
        """Return the numbers by the model; ValueError where it does not exist."""
        try:
            found = self.predictor.predictions(values)
        except ConfigError as error:
            raise ValueError(str(error)) from error
        inverse = self.measurement.plan.inverse
        return np.concatenate([_numbers(inverse @ found[name].channels.mean_dn) for name in self.regions])

    def geometry(self, region: str) -> "PanelGeometry | None":
        """Return directions of sun and camera over a panel; None where its radiance is given."""
        scene = self.inputs.scene
        own = next(one for one in scene.regions if one.name == region)
        if own.material is None or scene.sun is None:
            return None
        view = camera_view(scene)
        local = local_geometry(
            sun_zenith_rad=np.deg2rad(scene.sun.zenith_deg.value),
            sun_azimuth_rad=sun_azimuth_rad(scene),
            camera_zenith_rad=view.zenith_rad,
            camera_azimuth_rad=view.azimuth_rad,
            tilt=Tilt(
                tilt_rad=float(np.deg2rad(own.given.tilt_deg.value)),
                azimuth_rad=float(np.deg2rad(own.given.tilt_azimuth_deg.value)),
            ),
        )
        i, r, phi = (float(angle) for angle in (local.theta_i_rad, local.theta_r_rad, local.phi_rad))
        return PanelGeometry(
            sun=np.array([np.sin(i) * np.cos(phi), np.sin(i) * np.sin(phi), np.cos(i)]),
            camera=np.array([np.sin(r), 0.0, np.cos(r)]),
            turn=rotation(float(local.reflected_rotation_rad) + view.roll_rad)[1:, 1:],
        )


_LEAST_SNR = 10.0


def _numbers(stokes: FloatArray) -> FloatArray:
    """Return ln S0, S1/S0 and S2/S0."""
    if not stokes[0] > 0.0:
        raise ValueError(f"S0 is {stokes[0]:g}; a region needs light")
    return np.array([np.log(stokes[0]), stokes[1] / stokes[0], stokes[2] / stokes[0]])


def _slopes(stokes: FloatArray) -> FloatArray:
    s0, s1, s2 = stokes
    return np.asarray(np.array([[1.0, 0.0, 0.0], [-s1 / s0, 1.0, 0.0], [-s2 / s0, 0.0, 1.0]]) / s0)
