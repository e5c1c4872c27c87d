"""Checks of section V-A, Fig. 9: what of the polarization is the target's, and what is of the air before it."""

import numpy as np

from rigctl.paper.airborne import Geometry
from rigctl.paper.numbers import Number, Reading, Test, above, differ, falls
from rigctl.paper.statement import AS_STATED, AZIMUTHS_DEG, MUCH, PATH_TURNED, PaperScenes, both_azimuths, one_reading


def fig9_total_differs(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that total differs from reflected."""

    def tests(turned: bool) -> tuple[Test, ...]:
        found = (
            differ(
                scenes.airborne.snr(at, label=f"total {_place(at)}", turned=turned),
                scenes.airborne.snr(at, source="reflected", label=f"reflected {_place(at)}"),
            )
            for at in _fig9(scenes, (10.0, 50.0))
        )
        return tuple(test for test in found if test.verdict != "noise_floor")

    return both_azimuths(tests)


def fig9_path_above_reflected(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the path has the higher ratio."""

    def tests(turned: bool) -> tuple[Test, ...]:
        return tuple(
            above(
                scenes.airborne.snr(at, source="path", label=f"path phi {at.phi:g}", turned=turned),
                scenes.airborne.snr(at, source="reflected", label=f"reflected phi {at.phi:g}"),
            )
            for at in _fig9(scenes, (10.0,))
            if at.phi < 180.0
        )

    return both_azimuths(tests)


def fig9_total_much_higher_at_0(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the total is much higher at an azimuth of 0."""
    snr, at = scenes.airborne.snr, scenes.at(25.0, 10.0, 0.0)
    reflected = snr(at, source="reflected", label="reflected phi 0")

    def total(turned: bool) -> Number:
        return snr(at, label="total phi 0", turned=turned)

    def others(turned: bool) -> tuple[Test, ...]:
        return tuple(
            above(total(turned), snr(one, label=f"total phi {one.phi:g}", turned=turned), factor=MUCH)
            for one in (scenes.at(25.0, 10.0, 90.0), scenes.at(25.0, 10.0, 180.0))
        )

    return tuple(
        Reading(name=f"{name}; {azimuth}", tests=found)
        for turned, azimuth in ((False, AS_STATED), (True, PATH_TURNED))
        for name, found in (
            (f"{MUCH:g} times that of the reflected radiance there", (above(total(turned), reflected, factor=MUCH),)),
            (f"{MUCH:g} times that of the total at 90 and 180 deg", others(turned)),
        )
    )


def fig9_path_dominates(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the path is the more polarized light."""

    def tests(turned: bool) -> tuple[Test, ...]:
        path = scenes.airborne.polarized(scenes.at(25.0, 10.0, 180.0 if turned else 0.0), "path")
        return (above(path, scenes.airborne.polarized(scenes.at(25.0, 10.0, 0.0), "reflected")),)

    return both_azimuths(tests)


def fig9_total_misleads(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test two geometries of which the one with the higher total has the lower reflected ratio: the clearest pair."""

    def tests(turned: bool) -> tuple[Test, ...]:
        points = _fig9(scenes, (10.0, 50.0))
        total = [scenes.airborne.snr(at, label=f"total {_place(at)}", turned=turned) for at in points]
        reflected = [scenes.airborne.snr(at, source="reflected", label=f"reflected {_place(at)}") for at in points]
        pairs = [
            (above(total[i], total[j]), above(reflected[j], reflected[i]))
            for i in range(len(points))
            for j in range(len(points))
            if i != j
        ]
        return max(pairs, key=lambda pair: min(test.margin for test in pair))

    return both_azimuths(tests)


def fig9_reflected_rises(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the reflected ratio rises with the azimuth."""
    tests: list[Test] = []
    for view in (10.0, 50.0):
        found = [
            scenes.airborne.snr(at, source="reflected", label=f"reflected {_place(at)}")
            for at in _fig9(scenes, (view,))
        ]
        tests += falls(found[::-1])
    return one_reading(*tests)


def fig9_forward_is_strongest(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the reflected ratio is largest at an azimuth of 180."""
    tests: list[Test] = []
    for view in (10.0, 50.0):
        *others, forward = (
            scenes.airborne.snr(at, source="reflected", label=f"reflected {_place(at)}")
            for at in _fig9(scenes, (view,))
        )
        tests += [above(forward, other) for other in others]
    return one_reading(*tests)


def fig9_forward_is_purest(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that polarized light of the path over that of the target is least at an azimuth of 180."""

    def tests(turned: bool) -> tuple[Test, ...]:
        found: list[Test] = []
        for view in (10.0, 50.0):
            *others, forward = (_path_share(scenes, at, turned=turned) for at in _fig9(scenes, (view,)))
            found += [above(other, forward) for other in others]
        return tuple(found)

    return both_azimuths(tests)


def _path_share(scenes: PaperScenes, at: Geometry, *, turned: bool) -> Number:
    seen = scenes.at(at.sun, at.view, 180.0 - at.phi) if turned else at
    path, reflected = scenes.airborne.polarized(seen, "path"), scenes.airborne.polarized(at, "reflected")
    value = path.value / reflected.value
    error = value * float(np.hypot(path.error / path.value, reflected.error / reflected.value))
    return Number(label=f"polarized path over reflected {_place(at)}", value=value, error=error)


def fig9_oblique_is_higher(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that an oblique view has the higher ratio."""
    snr = scenes.airborne.snr
    return one_reading(
        *(
            above(
                snr(scenes.at(25.0, 50.0, phi), source="reflected", label=f"reflected view 50 phi {phi:g}"),
                snr(scenes.at(25.0, 10.0, phi), source="reflected", label=f"reflected view 10 phi {phi:g}"),
            )
            for phi in AZIMUTHS_DEG
        )
    )


def _fig9(scenes: PaperScenes, views: tuple[float, ...]) -> list[Geometry]:
    return [scenes.at(25.0, view, phi) for view in views for phi in AZIMUTHS_DEG]


def _place(at: Geometry) -> str:
    return f"view {at.view:g} phi {at.phi:g}"
