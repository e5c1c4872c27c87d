"""
An afternoon of runs against the model
======================================

A session at four times of one afternoon on the simulated roof of ``examples/rig-roof.toml``, each run set beside what
the model says for its own sun. On a real rig only the loop over ``rigctl.acquire`` differs: there, ``rigctl acquire``
with a ``[schedule]`` takes the runs while you are elsewhere.
"""

import tempfile
from importlib.resources import files
from pathlib import Path

from matplotlib import pyplot as plt

import rigctl

examples = Path(str(files("rigctl") / "data" / "examples")).resolve()
folder = Path(tempfile.mkdtemp())
rig_text = (examples / "rig-roof.toml").read_text().replace("scene-roof.toml", f"{examples}/scene-roof.toml")

# %%
# One run every two hours: the clock of the simulation begins then and does not wait.

runs = {}
for hour in (16, 18, 20, 22):
    rig = folder / f"rig-{hour}.toml"
    rig.write_text(rig_text.replace("[simulation]\n", f"[simulation]\nclock = 2010-05-25T{hour}:00:00Z\n"))
    runs[hour] = rigctl.acquire(rig, examples / "session-roof.toml", out=folder / f"run-{hour}").run
runs[16]

# %%
# Each run beside the model. The scene file has aerosol and surfaces; sun, angles and exposure are the run's own.

compared = {hour: rigctl.compare(run, examples / "scene-roof.toml") for hour, run in runs.items()}
compared[16]

# %%
# DoLP of each region over the afternoon: lines are the model, points what was measured, with two standard errors.

for region in ("black_panel", "white_panel", "asphalt"):
    rows = [found.table().query("region == @region and quantity == 'dolp' and statistic == 'mean'").iloc[0]
            for found in compared.values()]  # fmt: skip
    (line,) = plt.plot(list(compared), [row.predicted for row in rows], label=region)
    plt.errorbar(
        list(compared),
        [row.measured for row in rows],
        [2 * row.std_error for row in rows],
        fmt=".",
        color=line.get_color(),
    )
plt.xlabel("UTC [h]")
plt.ylabel("DoLP")
plt.legend()
plt.show()
