"""Long trials, run by `make trials`: uncertainty over many seeds, kills, power cuts, old pictures, lossy networks.

Usage: python -m benchmarks.trials [--seeds 200] [--perturbed-seeds 100] [--kills 200] [--lost-terminals 50]
    [--hard-times 5] [--day-cycles 35] [--monkey-cases 5000] [--cuts 50] [--turns 100] [--lossy-frames 100]
    [--processes 3] [--cases 10000] [--archived-runs 2000]
"""

import argparse
import sys
from pathlib import Path

from benchmarks.trials.archive import run_archive
from benchmarks.trials.coverage import run_coverage
from benchmarks.trials.damaged_runs import run_damaged
from benchmarks.trials.day import run_day
from benchmarks.trials.diagnosis import run_diagnoses
from benchmarks.trials.effects import run_effects
from benchmarks.trials.golden import run_golden
from benchmarks.trials.hard_times import run_hard_times
from benchmarks.trials.honesty import run_honesty
from benchmarks.trials.inference import CASES, run_inference
from benchmarks.trials.inputs import run_inputs
from benchmarks.trials.kills import run_kills, run_lost_terminals
from benchmarks.trials.loop_disk import why_not
from benchmarks.trials.lossy_network import run_losses
from benchmarks.trials.mosaic import run_mosaic
from benchmarks.trials.noise_sets import run_noise_sets
from benchmarks.trials.odd_runs import run_odd
from benchmarks.trials.pointing import run_pointing
from benchmarks.trials.power_cut import run_cuts
from benchmarks.trials.roof import run_roof
from benchmarks.trials.rows import run_rows
from benchmarks.trials.stale_frames import run_turns
from benchmarks.trials.study import run_study
from benchmarks.trials.sweeps import run_sweeps
from benchmarks.trials.tolerance import run_tolerance
from drivers.cameras.aravis import load_aravis
from drivers.errors import NotConnectedError
from tests.monkey.__main__ import run_monkey


def main() -> int:
    """Run the trials; return 1 where one fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--perturbed-seeds", type=int, default=100)
    parser.add_argument("--moved-seeds", type=int, default=60)
    parser.add_argument("--roof-seeds", type=int, default=40)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--lost-terminals", type=int, default=50)
    parser.add_argument("--hard-times", type=int, default=5)
    parser.add_argument("--day-cycles", type=int, default=35)
    parser.add_argument("--monkey-cases", type=int, default=5000)
    parser.add_argument("--cuts", type=int, default=50)
    parser.add_argument("--damaged", type=int, default=500)
    parser.add_argument("--effect-scenes", type=int, default=2000)
    parser.add_argument("--tolerance-scenes", type=int, default=1000)
    parser.add_argument("--sweeps", type=int, default=100)
    parser.add_argument("--mosaic-seeds", type=int, default=30)
    parser.add_argument("--turns", type=int, default=100)
    parser.add_argument("--lossy-frames", type=int, default=100)
    parser.add_argument("--processes", type=int, default=3)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--archived-runs", type=int, default=2000)
    parser.add_argument("--folder", type=Path, default=None, help="Keeps the scores (scores.csv).")
    arguments = parser.parse_args()
    sound = run_golden()
    sound &= run_damaged(arguments.damaged)
    sound &= run_pointing(arguments.seeds)
    sound &= run_monkey(arguments.monkey_cases)
    sound &= run_study(arguments.cases, kills=10)
    sound &= run_archive(arguments.archived_runs, arguments.archived_runs // 100, arguments.archived_runs)
    sound &= run_kills(arguments.kills)
    sound &= run_lost_terminals(arguments.lost_terminals)
    sound &= run_hard_times(arguments.hard_times)
    sound &= run_day(arguments.day_cycles)
    reason = why_not()
    if reason is None:
        sound &= run_cuts(arguments.cuts)
    else:
        print(f"power cuts were not simulated: {reason}")
    sound &= _run_network(turns=arguments.turns, frames=arguments.lossy_frames)
    sound &= run_effects(arguments.effect_scenes)
    sound &= run_effects(300, kind="hostile")
    sound &= run_effects(300, kind="thin")
    sound &= run_tolerance(arguments.tolerance_scenes, [0.1, 0.03, 0.01, 0.003])
    sound &= run_sweeps(range(arguments.sweeps))
    sound &= run_mosaic(arguments.mosaic_seeds)
    sound &= run_honesty(
        arguments.seeds, arguments.perturbed_seeds, processes=arguments.processes, folder=arguments.folder
    )
    sound &= run_diagnoses(2 * arguments.seeds, processes=arguments.processes)
    sound &= run_rows(arguments.seeds, processes=arguments.processes)
    sound &= run_coverage(
        (),
        seeds=5 * arguments.seeds,
        verdicts=arguments.seeds,
        processes=arguments.processes,
    )
    sound &= run_odd(2 * arguments.seeds, processes=arguments.processes)
    sound &= run_noise_sets(arguments.seeds, processes=arguments.processes)
    sound &= run_roof(arguments.roof_seeds, arguments.roof_seeds // 10, processes=arguments.processes)
    sound &= run_inputs(arguments.seeds, arguments.moved_seeds, processes=arguments.processes)
    for case in CASES:
        sound &= run_inference(case, draws=arguments.seeds, processes=arguments.processes)
    return 0 if sound else 1


def _run_network(*, turns: int, frames: int) -> bool:
    """Run the trials that need a GigE camera on this machine's own network."""
    try:
        load_aravis()
    except NotConnectedError as error:
        print(f"no trials over the network: {error}")
        return True
    is_current = run_turns(turns)
    return run_losses(frames) and run_losses(frames, (0.01, 0.05), resends=True) and is_current


if __name__ == "__main__":
    sys.exit(main())
