"""Long trials: each repeats something hundreds of times with random inputs and counts failures (see docs/trials.md).

python -m benchmarks.trials                 every trial, as `make trials` does
python -m benchmarks.trials NAME [OPTIONS]  a single one; `--help` lists its options
"""

import sys

from cyclopts import App

# Name, and the function whose arguments are the trial's options.
TRIALS = {
    "golden": "golden:run_golden",
    "damaged_runs": "damaged_runs:run_damaged",
    "pointing": "pointing:run_pointing",
    "monkey": "tests.monkey.__main__:run_monkey",
    "study": "study:run_study",
    "archive": "archive:run_archive",
    "floods": "floods:run_floods",
    "kills": "kills:run_kills",
    "lost_terminals": "kills:run_lost_terminals",
    "hard_times": "hard_times:run_hard_times",
    "day": "day:run_day",
    "power_cut": "power_cut:run_cuts",
    "stale_frames": "stale_frames:run_turns",
    "lossy_network": "lossy_network:run_losses",
    "fault_matrix": "fault_matrix:run_faults",
    "effects": "effects:run_effects",
    "tolerance": "tolerance:run_tolerance",
    "sweeps": "sweeps:run_sweeps",
    "white_panel": "white_panel:run_white_panel",
    "mosaic": "mosaic:run_mosaic",
    "honesty": "honesty:run_honesty",
    "diagnosis": "diagnosis:run_diagnoses",
    "rows": "rows:run_rows",
    "coverage": "coverage:run_coverage",
    "noise_sets": "noise_sets:run_noise_sets",
    "roof": "roof:run_roof",
    "inputs": "inputs:run_inputs",
    "inference": "inference:run_inference",
}


def main() -> int:
    """Run one trial or all; return 1 where one fails."""
    app = App(name="trials", help=__doc__, result_action="return_value")
    for name, place in TRIALS.items():
        app.command(place if place.startswith("tests.") else f"benchmarks.trials.{place}", name=name)
    runs = [sys.argv[1:]] if sys.argv[1:] else [[name] for name in TRIALS]
    failed = []
    for words in runs:
        if sys.argv[1:] == []:
            print(f"\n=== {words[0]}", flush=True)
        if app(words) is False:
            failed.append(words[0])
    print(f"failed: {', '.join(failed) or 'none'}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
