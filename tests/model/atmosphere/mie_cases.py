"""Reference numbers of other codes for spheres, and the aerosols they belong to."""

import json
from pathlib import Path

from model.atmosphere.mie import LogNormal, MieAerosol, ParticleMode, RefractiveIndex, TabulatedSizes, log_normal

_HERE = Path(__file__).parent
REFERENCE = json.loads((_HERE / "mie_reference.json").read_text())
SKY = json.loads((_HERE / "mie_sky.json").read_text())

# The rural aerosol as it is often quoted: two log-normal modes of one substance, dry.
NOMINAL_RURAL = MieAerosol(
    name="nominal rural",
    source="Shettle & Fenn (1979)",
    modes=tuple(
        ParticleMode(
            number_share=share,
            sizes=log_normal(number_median_radius_m=radius_m, log10_sigma=sigma),
            index=RefractiveIndex(n=(1.53,), k=(0.0066,)),
        )
        for share, radius_m, sigma in ((0.999875, 0.03e-6, 0.35), (0.000125, 0.5e-6, 0.40))
    ),
)


def aerosol_of(case):
    """Aerosol of one of the reference's distributions."""
    return MieAerosol(name=case["name"], source="test", modes=tuple(_mode(mode) for mode in case["modes"]))


def _mode(mode):
    if mode["law"] == "table":
        sizes = TabulatedSizes(radius_m=tuple(mode["r"]), number_per_log_radius_at=tuple(mode["n"]))
    else:
        sizes = LogNormal(
            median_radius_m=mode["median"], ln_sigma=mode["s"], largest_radius_m=mode.get("cut", float("inf"))
        )
    n, k = mode["nk"]
    return ParticleMode(number_share=mode["share"], sizes=sizes, index=RefractiveIndex(n=(n,), k=(k,)))
