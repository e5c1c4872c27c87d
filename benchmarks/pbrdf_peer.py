"""Other programs' evaluation of the table that pbrdf_speed.py writes; runs under the Python that has them.

Run by pbrdf_speed.py: PYTHON benchmarks/pbrdf_peer.py TABLE.npz OUT.npz

The table holds theta_i, theta_r, phi [rad] and n, slope_rms. Written are, for each program that can be imported,
geometries per second and F (or F00 alone). Both programs take one geometry a call from Python here; the loop is in
the time, as it would be in a user's.
"""

import math
import sys
import time

import numpy as np


def scatmech(table):
    from pySCATMECH.brdf import BRDF_Model

    # Text of plain floats: a numpy scalar's repr is read as 0 without a word.
    model = BRDF_Model(
        "Shadowed_Facet_BRDF_Model",
        {
            "lambda": "0.55",
            "substrate": f"({float(table['n'])},0)",
            "type": "0",
            "sdf": "Gaussian_Slope_Distribution_Function",
            "sdf.s": repr(math.sqrt(2.0) * float(table["slope_rms"])),
            "stack": "No_StackModel",
            "shadow": "Torrance_Sparrow_Shadow_Function",
        },
    )
    angles = list(zip(table["theta_i"].tolist(), table["theta_r"].tolist(), table["phi"].tolist(), strict=True))
    start = time.perf_counter()
    found = [model.MuellerBRDF(theta_i, theta_r, phi - math.pi, 0.0, "psps") for theta_i, theta_r, phi in angles]
    seconds = time.perf_counter() - start
    return len(angles) / seconds, np.array([np.array(matrix)[:3, :3] for matrix in found])


def mitsuba(table):
    import mitsuba

    mitsuba.set_variant("scalar_spectral_polarized")
    bsdf = mitsuba.load_dict(
        {
            "type": "roughconductor",
            "eta": {"type": "uniform", "value": float(table["n"])},
            "k": {"type": "uniform", "value": 0.0},
            "distribution": "beckmann",
            "alpha": math.sqrt(2.0) * float(table["slope_rms"]),
        }
    )
    theta_i, theta_r, phi = table["theta_i"], table["theta_r"], table["phi"]
    zero = np.zeros_like(theta_i)
    to_sun = np.stack([np.sin(theta_i), zero, np.cos(theta_i)], axis=1).tolist()
    to_camera = np.stack([np.sin(theta_r) * np.cos(phi), np.sin(theta_r) * np.sin(phi), np.cos(theta_r)], axis=1)
    to_camera = to_camera.tolist()
    context, interaction = mitsuba.BSDFContext(), mitsuba.SurfaceInteraction3f()
    found = []
    start = time.perf_counter()
    for sun, camera in zip(to_sun, to_camera, strict=True):
        interaction.wi = camera
        found.append(bsdf.eval(context, interaction, sun))
    seconds = time.perf_counter() - start
    intensity = np.array([np.array(matrix).ravel()[0] for matrix in found])
    return theta_i.size / seconds, intensity / np.cos(theta_i)


def main():
    table, out = np.load(sys.argv[1]), {}
    for name, evaluate in (("SCATMECH", scatmech), ("Mitsuba", mitsuba)):
        try:
            out[f"{name}_per_s"], out[f"{name}_f"] = evaluate(table)
        except ImportError:
            continue
    np.savez(sys.argv[2], **out)


if __name__ == "__main__":
    main()
