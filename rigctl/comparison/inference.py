"""From measured regions of runs and a scene to the posterior of the scene's uncertain numbers (`rigctl infer`).

Of every region ln S0, S1/S0 and S2/S0 are compared, with the covariance of the run's mean counts. Chosen inputs are
inferred; all other uncertain inputs of the scene widen the covariance, to first order. Numerical settings are those of
a stated tolerance, and their errors are part of the covariance too.

The model's discrepancy has two scales, of ln S0 and of polarization. It is a smooth function of the directions of sun
and camera over the panel, so that many runs in nearly one geometry do not average it away; half of its variance is
common to all regions, since they share the equations. Regions given by their radiance have none.

Computed points of the model are kept in a file, under a hash of all that they follow from. A killed command that is
given again reads them and ends in the same numbers.
"""

import hashlib
import io
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from model.moments import propagate_linear
from model.processing import posterior as bayes
from model.processing.posterior import Posterior, Problem
from model.stokes import rotation
from model.surface.pbrdf import Tilt, local_geometry
from rigctl.base.durable import read_arrays, write_durably
from rigctl.comparison.checks import not_judged, refused_regions, run_checks, titles, verdict_of
from rigctl.comparison.compare import accuracy_at
from rigctl.comparison.predict_run import RunPredictor, run_predictor
from rigctl.comparison.scale import panel_scaled, without_throughput
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import ScaleKind
from rigctl.mapped import code_version
from rigctl.measure.diagnose import MeasuredRun
from rigctl.measure.measure import Measurement
from rigctl.scene.light import SceneLight, camera_view, sun_azimuth_rad
from rigctl.scene.scene import Inputs, Parameter, Scene, get, only_uncertain

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
class Evidence:
    """Runs and a scene, ready to be inferred from."""

    runs: tuple[str, ...]
    parameters: tuple[Parameter, ...]  #: inferred inputs, with the prior of the scene
    problem: Problem
    regions: tuple[tuple[str, str], ...]  #: run and region of each three of the data
    untaught: tuple[str, ...]  #: uncertain inputs that are not inferred
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
        blocks = np.arange(self.evidence.problem.data.size).reshape(-1, 3)
        return bayes.block_p_values(self.evidence.problem, self.posterior, list(blocks), discrepancy=discrepancy)


def gather_evidence(
    measured: Sequence[MeasuredRun],
    scenes: Sequence[Scene],
    *,
    chosen: Sequence[str] = (),
    scale: ScaleKind = "absolute",
    discrepancy: float = 0.02,
) -> Evidence:
    """Return the evidence of runs; `scenes` has the scene with the noise calibration of each run."""
    remarks: dict[str, None] = {}
    used = []
    for one, scene in zip(measured, scenes, strict=True):
        run, said = _taken_run(one, scene, scale=scale, discrepancy=discrepancy)
        remarks |= dict.fromkeys(said)
        used += [] if run is None else [run]
    if not used:
        raise DataError("no region of any run can be used: " + "; ".join(remarks))
    joint = _Joint(used)
    slopes = joint.slopes()
    kept = _inferred(joint, slopes, chosen, discrepancy)
    rest = [k for k in range(len(joint.inputs.names)) if k not in kept]
    inputs = joint.inputs
    digest = hashlib.sha256(repr([chosen, scale, discrepancy, code_version(_PACKAGES)]).encode())
    for run in used:
        digest.update(repr(run.inputs.scene).encode() + run.numbers.tobytes() + run.cov.tobytes())
    return Evidence(
        runs=tuple(run.name for run in used),
        parameters=tuple(get(inputs.scene, inputs.names[k]) for k in kept),
        problem=joint.problem(kept, rest, slopes, discrepancy),
        regions=tuple((run.name, region) for run in used for region in run.regions),
        untaught=tuple(inputs.names[k] for k in rest),
        remarks=tuple(remarks),
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
    """Return the posterior of the inputs; computed points of the model are kept in a folder, and read from there."""
    if find_spec("emcee") is None:
        raise ConfigError("rigctl infer needs emcee: pip install 'rigctl[infer]'")
    problem = evidence.problem
    if folder is not None:
        problem = replace(problem, model=_kept(problem.model, folder / f"{evidence.digest}-points.npz"))
    try:
        found = bayes.infer(problem, seed=seed, most_steps=most_steps, tell=tell)
    except bayes.NotConvergedError as error:
        raise DataError(str(error)) from error
    return Inference(evidence=evidence, posterior=found)


def _kept(model: Callable[[FloatArray], FloatArray], path: Path) -> Callable[[FloatArray], FloatArray]:
    """Return a model whose computed points are kept in a file; a damaged file is as good as none."""
    known: dict[bytes, FloatArray] = {}
    with suppress(DataError):
        points = read_arrays(path)
        known = {inputs.tobytes(): numbers for inputs, numbers in zip(points["inputs"], points["numbers"], strict=True)}

    def kept(values: FloatArray) -> FloatArray:
        key = values.tobytes()
        if key not in known:
            known[key] = model(values)
            buffer = io.BytesIO()
            inputs = np.array([np.frombuffer(one) for one in known])
            np.savez(buffer, allow_pickle=False, inputs=inputs, numbers=np.array(list(known.values())))
            write_durably(path, buffer.getvalue())
        return known[key]

    return kept


def _inferred(joint: "_Joint", slopes: FloatArray, chosen: Sequence[str], discrepancy: float) -> list[int]:
    """Return the positions of the inputs to infer: the chosen ones, or those that the runs determine."""
    names = joint.inputs.names
    unknown = [key for key in chosen if key not in names]
    if unknown:
        get(joint.inputs.scene, unknown[0])  # raises an error that lists the keys
        raise ConfigError(f"--input: {', '.join(unknown)} has no std in the scene file; the prior needs one")
    if chosen:
        return [k for k, name in enumerate(names) if name in chosen]
    whole = joint.problem(list(range(len(names))), [], slopes, discrepancy)
    total = whole.total_cov(np.asarray(whole.discrepancy_median))
    _, cov = bayes.linear_update(slopes @ whole.root, np.zeros(len(whole.data)), total)
    share = np.diag(whole.root @ cov @ whole.root.T) / np.diag(whole.cov)
    kept = np.flatnonzero(share < 1.0 - _LEAST_RESOLVED).tolist()
    if not kept:
        raise DataError("the runs determine no uncertain input; give other inputs a std, or choose some with --input")
    return list(kept)


class _Joint:
    """Several runs together: the same inputs are off by the same amount in all of them."""

    def __init__(self, runs: Sequence["_Run"]) -> None:
        self._runs = runs
        self.inputs = only_uncertain(runs[0].inputs)
        if not self.inputs.names:
            raise ConfigError(
                f"scene {self.inputs.scene.name}: no number is uncertain, so nothing can be inferred; write "
                "{ value = ..., std = ... } or { range = [..., ...] } for the numbers to infer"
            )

    def model(self, values: FloatArray) -> FloatArray:
        """Return the numbers of all runs at values of the uncertain inputs; ValueError if there is no model of them."""
        found = []
        for run in self._runs:
            moved = run.inputs.values.copy()
            for name, move in zip(self.inputs.names, values - self.inputs.values, strict=True):
                if name in run.inputs.names:
                    moved[run.inputs.names.index(name)] += move
            found.append(run.modelled(moved))
        return np.concatenate(found)

    def slopes(self) -> FloatArray:
        """Return the change of the numbers by each input, per unit of the input, shape (N, inputs)."""
        std = np.sqrt(np.diag(self.inputs.cov))
        centre = self.model(self.inputs.values)
        sides = np.full((2, std.size, centre.size), np.nan)
        for side, sign in enumerate((1.0, -1.0)):
            for k, step in enumerate(sign * std):
                values = self.inputs.values.copy()
                values[k] += step
                if self.inputs.least[k] <= values[k] <= self.inputs.most[k]:
                    with suppress(ValueError):
                        sides[side, k] = self.model(values)
        return bayes.central_slopes(centre, *sides) / std

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

        places = [(region, run.geometry(region)) for run in self._runs for region in run.regions]
        shapes = _discrepancy_shapes(places) if discrepancy > 0.0 else ()
        return Problem(
            mean=inputs.values[kept],
            cov=own,
            least=inputs.least[kept],
            most=inputs.most[kept],
            model=model,
            data=np.concatenate([run.numbers for run in self._runs]),
            noise_cov=block_diag(*(run.cov for run in self._runs)) + slopes[:, rest] @ left @ slopes[:, rest].T,
            discrepancy=shapes,
            discrepancy_median=(RADIANCE_SHARE * discrepancy, discrepancy)[: len(shapes)],
        )


# Directions of sun and camera over a panel, unit vectors of shape (2, 3) with the panel's normal upwards and the camera
# at azimuth 0; and the rotation of (S1, S2) from the panel's axes to the camera's.
_Geometry = tuple[FloatArray, FloatArray]


def _discrepancy_shapes(places: Sequence[tuple[str, _Geometry | None]]) -> tuple[FloatArray, ...]:
    """Return the covariance of the discrepancy of ln S0 and of polarization for scales of 1; empty without materials.

    In the axes of a panel S2 changes its sign with the azimuth of the sun, by symmetry, for any model and in nature: so
    does its discrepancy, which is 0 in the principal plane and says nothing there of that of S1.
    """
    if all(geometry is None for _, geometry in places):
        return ()
    radiance, polarization = np.zeros((2, 3 * len(places), 3 * len(places)))
    for i, (region, geometry) in enumerate(places):
        for j, (other_region, other) in enumerate(places):
            if geometry is None or other is None:
                continue
            share = 1.0 if region == other_region else _COMMON
            (own, turn), (far, other_turn) = geometry, other
            # What a smooth function of both directions has in common with the other geometry and with its mirror image.
            direct, across = (
                float(np.exp(-0.5 * np.sum((own - far * mirror) ** 2) / _SMOOTH_RAD**2))
                for mirror in (np.ones(3), np.array([1.0, -1.0, 1.0]))
            )
            radiance[3 * i, 3 * j] = share * direct
            of_panel = share * np.diag([direct, direct - across])
            polarization[3 * i + 1 : 3 * i + 3, 3 * j + 1 : 3 * j + 3] = turn @ of_panel @ other_turn.T
    return radiance, polarization


@dataclass(frozen=True, kw_only=True, eq=False)
class _Run:
    """One run: the measured numbers of its usable regions with their covariance, and the model of them."""

    name: str
    regions: tuple[str, ...]
    predictor: RunPredictor
    inputs: Inputs
    inverse: FloatArray  #: from the angles to Stokes parameters
    numbers: FloatArray
    cov: FloatArray

    def modelled(self, values: FloatArray) -> FloatArray:
        """Return the numbers by the model; ValueError where it does not exist."""
        try:
            found = self.predictor.predictions(values)
        except ConfigError as error:
            raise ValueError(str(error)) from error
        return np.concatenate([_numbers(self.inverse @ found[name].channels.mean_dn) for name in self.regions])

    def geometry(self, region: str) -> _Geometry | None:
        """Return directions over a panel; None where its radiance is given."""
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
        sun = (np.sin(i) * np.cos(phi), np.sin(i) * np.sin(phi), np.cos(i))
        camera = (np.sin(r), 0.0, np.cos(r))
        return np.array([sun, camera]), rotation(float(local.reflected_rotation_rad) + view.roll_rad)[1:, 1:]


def _taken_run(
    run: MeasuredRun, scene: Scene, *, scale: ScaleKind, discrepancy: float
) -> tuple[_Run | None, tuple[str, ...]]:
    """Return a run, or None if no region can be used, and remarks."""
    measurement, radiometric = run.measurement, run.calibrations.radiometric
    name, inverse = measurement.run.path.resolve().name, measurement.plan.inverse
    checks = run_checks(run)
    if verdict_of((), checks, {}) == "cannot_be_judged":
        raise DataError(f"{measurement.run.path}: {not_judged(checks)}")
    predictor = run_predictor(measurement, scene)
    left_out = measurement.unmeasured | refused_regions(checks)
    for region in predictor.inputs.scene.regions:
        if region.name in measurement.regions and region.name not in left_out:
            moments = propagate_linear(measurement.regions[region.name].channels_mean, inverse)
            if not moments.mean[0] > _LEAST_SNR * np.sqrt(moments.cov[0, 0]):
                left_out = left_out | {region.name: "its light is not above its error"}
    regions = tuple(
        one.name
        for one in predictor.inputs.scene.regions
        if one.name in measurement.regions and one.name not in left_out
    )
    flagged = titles(checks, "flagged")
    remarks = [f"{name}: {region} left out: {why}" for region, why in left_out.items()]
    remarks += [f"{name}: flagged: {flagged}"] if flagged else []
    if not regions:
        return None, tuple(remarks)
    accuracy = accuracy_at(predictor, float(np.clip(_NUMERICAL_SHARE * discrepancy, _FINEST, _COARSEST)), "safe")
    predictor = replace(
        predictor.without(accuracy.left_out),
        settings=accuracy.predicted.result.settings,
        # The sky of each point is used only here.
        light=SceneLight(is_kept_between_runs=False),
    )
    inputs = predictor.inputs
    if scale == "free":
        inputs = without_throughput(inputs)
    if scale == "panel":
        if radiometric is None:
            raise ConfigError("--scale panel and --radiometric FILE (rigctl calibrate radiometric) go together")
        inputs = panel_scaled(inputs, radiometric, exposure_s=predictor.exposure_s)[0]
    numbers, cov = _measured(measurement, regions)
    of_model = [
        accuracy.in_tolerance(region, quantity, "mean") for region in regions for quantity in ("s0", "s1n", "s2n")
    ]
    cov = cov + np.diag(np.square(of_model))
    if scale == "free":
        shift = np.tile([_ANY_SCALE, 0.0, 0.0], len(regions))
        cov = cov + np.outer(shift, shift)
    taken = _Run(
        name=name, regions=regions, predictor=predictor, inputs=inputs, inverse=inverse, numbers=numbers, cov=cov
    )
    return taken, (*remarks, *predictor.remarks, *inputs.scene.remarks)


_LEAST_SNR = 10.0


def _measured(measurement: Measurement, regions: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return the measured numbers of regions and their covariance; all regions share the error of the dark level."""
    inverse = measurement.plan.inverse
    level = measurement.frames.dark_level.std_error_dn * measurement.grid.to_unit
    means = [measurement.regions[name].channels_mean for name in regions]
    stokes = [inverse @ mean.mean for mean in means]
    slopes = [
        np.array([[1.0, 0.0, 0.0], [-s1 / s0, 1.0, 0.0], [-s2 / s0, 0.0, 1.0]]) / s0 @ inverse for s0, s1, s2 in stokes
    ]
    shared = np.outer(level, level)
    blocks = [
        [one @ (mean.cov if one is other else shared) @ other.T for other in slopes]
        for one, mean in zip(slopes, means, strict=True)
    ]
    return np.concatenate([_numbers(one) for one in stokes]), np.block(blocks)


def _numbers(stokes: FloatArray) -> FloatArray:
    """Return ln S0, S1/S0 and S2/S0."""
    if not stokes[0] > 0.0:
        raise ValueError(f"S0 is {stokes[0]:g}; a region needs light")
    return np.array([np.log(stokes[0]), stokes[1] / stokes[0], stokes[2] / stokes[0]])
