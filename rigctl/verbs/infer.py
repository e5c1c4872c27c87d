"""`rigctl infer`: the posterior of a scene's uncertain numbers from one run or several."""

from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Unpack

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import Json, note, steps_shown
from rigctl.errors import ConfigError
from rigctl.verbs.options import FilePath, Files, Part, RegionsPath, Result, RunPath, ScaledOptions, ScenePath, Writes

if TYPE_CHECKING:
    from rigctl.comparison.inference import Inference

_FILES = ("posterior.json", "posterior.csv", "draws.csv", "corner.png", "check.png", "*.toml")


def infer(
    run: RunPath,
    /,
    *more: RunPath | ScenePath,
    scene: ScenePath | None = None,
    inputs: Annotated[Sequence[str], Parameter(name="--input")] = (),
    regions: RegionsPath | None = None,
    discrepancy: Annotated[float, Parameter(validator=Number(gte=0.0, lte=1.0))] = 0.02,
    most_steps: Annotated[int, Parameter(validator=Number(gte=250))] = 20_000,
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 1,
    out: Annotated[FilePath | None, Writes(kind="folder", names=_FILES)] = None,
    **options: Unpack[ScaledOptions],
) -> "InferenceResult":
    """Infer uncertain numbers of a scene from runs: material, aerosol, pointing, scale.

    The prior is the scene file: every number with a std. The answer is the posterior of the numbers that the runs
    determine better than the prior, or of those given by --input; all other uncertain numbers widen it. The size of a
    model error (discrepancy) is inferred too, so that a model that does not fit gives a wide posterior.

    With --out, computed points of the model are kept, and an interrupted inference continues from them.

    The exit code is 4 if the chain has not converged, and 5 if even the discrepancy does not explain the runs.

    Example: rigctl infer runs/panels examples/scene-panels-uncertain.toml --noise noise.json --out inferred

    Parameters
    ----------
    run : path or Run
        Run folder.
    more : path
        More run folders of the same rig; the scene file may be the last argument.
    scene : path or SceneFile
        Scene file, if it is not the last argument.
    inputs : sequence of str
        Key of a number to infer, such as atmosphere.visibility_km; default: all that the runs determine. Repeatable.
    regions : path or sequence of Region
        Regions file with new outlines for the scene's regions.
    discrepancy : float
        Expected error of the model in S1/S0 and S2/S0, and five times this in ln S0. 0 means a perfect model.
    most_steps : int
        Largest number of steps of a chain.
    seed : int
        Seed of the random numbers.
    out : path
        Folder for numbers, pictures, draws and inferred materials.
    **options
        Calibrations, scale and effects, see `ScaledOptions`.

    Returns
    -------
    InferenceResult
        Prior and posterior of each input, and how well the model explains each region.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, a run is unfit for inference, or the chain has not converged.
    """
    from rigctl.comparison.inference import gather_evidence, infer_inputs
    from rigctl.comparison.series import require_one_instrument
    from rigctl.mapped import PARTS_FOLDER, held_folder
    from rigctl.verbs.compare import read_scene_run, runs_and_scene

    runs, scene = runs_and_scene(run, more, scene)
    if scene is None:
        raise ConfigError("give a scene file, last or with --scene: its numbers with a std are the prior")
    read = [read_scene_run(one, scene, regions, options) for one in runs]
    require_one_instrument([one.measurement.run for one, _ in read])
    folder = None if out is None else Path(out)
    with steps_shown() as tell, nullcontext() if folder is None else held_folder(folder):
        evidence = gather_evidence(
            [one for one, _ in read],
            [model for _, model in read if model is not None],
            chosen=tuple(inputs),
            scale=options.get("scale", "absolute"),
            discrepancy=discrepancy,
        )
        found = infer_inputs(
            evidence,
            seed=seed,
            most_steps=most_steps,
            folder=None if folder is None else folder / PARTS_FOLDER,
            tell=tell,
        )
        result = InferenceResult(inference=found)
        if folder is not None:
            note(f"posterior: {', '.join(str(folder / name) for name in result.write(folder))}", below=True)
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class InferenceResult(Result):
    """Posterior of a scene's inputs: a sentence, tables, and the content of `posterior.json`."""

    inference: "Inference"  #: draws, prior, data and covariance

    @property
    def exit_code(self) -> int:
        """5 if the model does not explain the runs, even with its discrepancy."""
        from rigctl.console import EXIT_DISAGREES
        from rigctl.report.inference import unexplained

        return EXIT_DISAGREES if unexplained(self.inference) else 0

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumptions, and data that were overruled or left out."""
        return self.inference.evidence.remarks

    def content(self) -> Iterable[Part]:
        """Return the inputs that the runs determine, prior and posterior of each, and the fit of each region."""
        from rigctl.report import inference as report

        found = self.inference
        yield report.answer(found)
        yield report.inputs_table(found)
        yield from report.doubts(found)
        yield report.regions_table(found)
        yield report.effort(found)
        yield lambda: report.corner_png(found)

    def as_json(self) -> dict[str, Json]:
        """Return the content of posterior.json."""
        from rigctl.report.inference import inference_json

        return inference_json(self.inference)

    def output_files(self) -> Files:
        """Return numbers, pictures, draws and inferred materials."""
        from rigctl.report.inference import inference_files

        return inference_files(self.inference)

    def table(self, *, backend: Literal["pandas", "polars"] = "pandas") -> Any:
        """Return prior, posterior and information gain of each input as a data frame."""
        from rigctl.report.inference import inputs_table

        return inputs_table(self.inference).data_frame(backend)
