"""
DoLP of panels against the view angle
=====================================

What a camera sees of paint and asphalt as it goes down towards the horizon: the model over a range of one number of a
scene file, in ten lines.
"""

from importlib.resources import files

import numpy as np
from matplotlib import pyplot as plt

import rigctl

examples = files("rigctl") / "data" / "examples"
swept = rigctl.sweep(str(examples / "scene-airborne.toml"), "geometry.camera_zenith_deg", np.arange(5, 76, 10))
numbers = swept.table()
dolp = numbers[(numbers.quantity == "dolp") & (numbers.statistic == "mean")]
for region, rows in dolp.groupby("region"):
    plt.plot(rows["geometry.camera_zenith_deg"], rows.value, ".-", label=region)
plt.xlabel("view angle [deg]")
plt.ylabel("DoLP")
plt.legend()
plt.show()
