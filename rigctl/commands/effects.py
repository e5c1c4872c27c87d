"""``rigctl effects``: which effects a scene calls for, and why."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, progress, results, solving_shown
from rigctl.files.choices import EffectRule
from rigctl.reports.writers.terminal_table import terminal_table

if TYPE_CHECKING:
    from rigctl.jobs.effects import PlannedEffects
    from rigctl.simulated.rendering_costs import RenderingCosts

# A bound that does not hold is a fault of the program's own.
_EXIT_VIOLATION = 70


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml|RIG.toml", help="Scene file, or rig file.")],
    tolerance: Annotated[
        float, typer.Option(metavar="T", min=1e-9, max=1.0, help="Of a prediction; effects may take half of it.")
    ] = 0.01,
    rule: Annotated[
        EffectRule,
        typer.Option(
            "--effects", metavar="RULE", help="Leave out by bounds (safe), by estimates (estimated), or not (all)."
        ),
    ] = "safe",
    verify: Annotated[
        bool, typer.Option("--verify", help="Evaluate every effect, acting or not: what it changes, and its time.")
    ] = False,
    switched_on: Annotated[list[str] | None, typer.Option("--with", metavar="NAME", help="Let an effect act.")] = None,
    left_out: Annotated[
        list[str] | None, typer.Option("--without", metavar="NAME", help="Leave an effect out, whatever its bound.")
    ] = None,
    noise: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Noise calibration; takes the place of the assumed noise.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Print every effect of the model with the most that leaving it out can change, and whether the scene calls for it.

    An effect is left out while the sum of the bounds of all that is stays within half of the tolerance. Bounds: of
    radiance and counts (relative), of DoLP, S1/S0, S2/S0 (absolute), of deviations and SNR (relative), of probabilities
    of detection (absolute). Beside the bound stands an estimate by a coarse evaluation, with its error; --effects says
    which of both decides. --verify evaluates the chain with and without each; a bound that does not hold is an error.

    Of a rig file with [simulation]: the effects that the simulated camera's pictures go through, and what each costs.

    Example: rigctl effects examples/scene-panels.toml --tolerance 0.02 --verify

    Example: rigctl effects examples/rig-effects.toml
    """
    from rigctl.jobs.effects import effects_of_rig, plan_scene_effects

    rendered = effects_of_rig(scene)
    if rendered is not None:
        _show_rendered(rendered, as_json=as_json)
        return
    with solving_shown() as tell:
        planned = plan_scene_effects(
            scene,
            tolerance=tolerance,
            verify=verify,
            switched_on=switched_on or (),
            left_out=left_out or (),
            noise=noise,
            rule=rule,
            tell=tell,
        )
    _show(planned, as_json=as_json)
    checked = planned.verification
    if checked is not None and checked.violations:
        names = ", ".join(one.effect.value for one in checked.violations)
        progress().print(f"a bound does not hold: {names}. This is a fault of the program: please report the scene")
        raise typer.Exit(_EXIT_VIOLATION)


def _show_rendered(rendered: "RenderingCosts", *, as_json: bool) -> None:
    from rigctl.reports.tables.effects_tables import rendering_json, rendering_table

    if as_json:
        print_json(rendering_json(rendered))
    else:
        results().print(terminal_table(rendering_table(rendered)))


def _show(planned: "PlannedEffects", *, as_json: bool) -> None:
    from rigctl.reports.tables.effects_tables import effects_json, effects_table, saved_line

    checked = planned.verification
    if as_json:
        print_json(effects_json(planned.plan, checked) | {"remarks": list(planned.remarks)})
        return
    results().print(terminal_table(effects_table(planned.plan, checked)))
    if checked is not None:
        results().print(saved_line(checked))
    for remark in planned.remarks:
        progress().print(remark)
