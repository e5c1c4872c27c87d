"""Computed skies kept between runs: records as bytes and back, entries by their inputs, damage, a full folder."""

import hashlib
from dataclasses import dataclass, field

import numpy as np
import pytest

from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.layers import AerosolKind, Layer
from model.atmosphere.solver import solve
from rigctl.scene.light import (
    NotStorableError,
    SkyStore,
    decode,
    encode,
    fingerprint,
    solver_sources,
    user_cache_folder,
)

LAYERS = (Layer(tau_rayleigh=0.05, tau_aerosol=0.1, ssa_aerosol=0.9, g_aerosol=0.6, delta=0.96),)
SETTINGS = {"mu0": 0.7, "albedo": 0.1, "nodes": 4, "element_depth": 0.1, "tolerance": 1e-3}


@dataclass(frozen=True, eq=False)
class Inner:
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Outer:
    parts: tuple[Inner, ...]
    modes: range
    number: float
    converged: bool
    nothing: None
    made: list = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "made", [self.number])


def record(number=1.5):
    inner = Inner(values=np.arange(6.0).reshape(2, 3))
    return Outer(parts=(inner, inner), modes=range(3, 7), number=number, converged=True, nothing=None)


def test_a_record_comes_back_as_it_was_and_one_object_is_one_again():
    found = decode(encode(record()), {"Inner": Inner, "Outer": Outer})
    np.testing.assert_array_equal(found.parts[0].values, record().parts[0].values)
    assert (found.modes, found.number, found.converged, found.nothing) == (range(3, 7), 1.5, True, None)
    assert found.made == [1.5]
    assert found.parts[0] is found.parts[1]
    assert decode(encode((np.float64(0.1), np.bool_(True))), {}) == (0.1, True)


def test_fingerprints_tell_numbers_apart_and_nothing_else():
    assert fingerprint(record()) == fingerprint(record())
    assert fingerprint(record(1.5)) != fingerprint(record(np.nextafter(1.5, 2.0)))
    changed = Inner(values=np.arange(6.0).reshape(2, 3) + 1e-16 * np.eye(2, 3))
    assert fingerprint(changed) != fingerprint(Inner(values=np.arange(6.0).reshape(2, 3)))
    assert fingerprint(Inner(values=np.zeros((2, 3)))) != fingerprint(Inner(values=np.zeros((3, 2))))


def test_what_is_no_record_of_numbers_is_refused_and_no_unexpected_class_is_made():
    with pytest.raises(NotStorableError):
        encode((1.0, object()))
    with pytest.raises(KeyError):
        decode(encode(record()), {"Outer": Outer})


class Counted:
    """The solver, counting its calls."""

    def __init__(self):
        self.calls = 0

    def __call__(self, layers, **settings):
        self.calls += 1
        return solve(layers, **settings)


@pytest.fixture
def solver():
    return Counted()


def light(solution):
    return solution.stokes(solution.depth, [0.2, 0.8], [0.3, 2.0], looking="up")


def matrices():
    column_of_air = column(AtmosphereState(visibility_m=23e3), wavelength_m=550e-9)
    return column_of_air.layers(fine=False, aerosol=AerosolKind.SPHERES)


@pytest.mark.parametrize(
    ("layers", "settings"),
    [(lambda: LAYERS, SETTINGS), (matrices, SETTINGS | {"aerosol": AerosolKind.SPHERES})],
    ids=["plain", "scattering matrices"],
)
def test_a_second_run_takes_what_the_first_computed(tmp_path, solver, layers, settings):
    first = SkyStore(tmp_path, solver=solver)(layers(), **settings)
    again = SkyStore(tmp_path, solver=solver)
    np.testing.assert_array_equal(light(again(layers(), **settings)), light(first))
    assert (solver.calls, again.taken, again.computed, again.remarks) == (1, 1, 0, [])


@pytest.mark.parametrize("change", [{"mu0": 0.7000001}, {"albedo": 0.2}, {"aerosol": "polarizing"}, {"nodes": 5}])
def test_other_inputs_are_another_sky(tmp_path, solver, change):
    store = SkyStore(tmp_path, solver=solver)
    store(LAYERS, **SETTINGS)
    store(LAYERS, **(SETTINGS | change))
    assert solver.calls == 2


def _flip_a_bit(data):
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


def _no_sky(data):
    body = b"no archive"
    return b"rigctl sky 1 sha256 " + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


@pytest.mark.parametrize(
    "spoil",
    [_flip_a_bit, lambda data: data[:-10], lambda data: b"", lambda data: data.replace(b"sky 1", b"sky 2", 1), _no_sky],
)
def test_a_damaged_entry_is_computed_anew_and_replaced(tmp_path, solver, spoil):
    right = light(SkyStore(tmp_path, solver=solver)(LAYERS, **SETTINGS))
    (entry,) = tmp_path.iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(spoil(whole))
    store = SkyStore(tmp_path, solver=solver)
    np.testing.assert_array_equal(light(store(LAYERS, **SETTINGS)), right)
    assert solver.calls == 2
    assert any("damaged" in remark for remark in store.remarks)
    assert entry.read_bytes() == whole


def test_a_folder_that_cannot_be_written_costs_time_only(tmp_path, solver):
    blocked = tmp_path / "file"
    blocked.write_text("here stands a file")
    store = SkyStore(blocked / "skies", solver=solver)
    store(LAYERS, **SETTINGS)
    assert solver.calls == 1
    assert any("cannot be" in remark for remark in store.remarks)


def test_a_full_folder_loses_what_was_not_used_for_longest(tmp_path, solver):
    SkyStore(tmp_path, solver=solver)(LAYERS, **SETTINGS)
    (entry,) = tmp_path.iterdir()
    size = entry.stat().st_size
    store = SkyStore(tmp_path, solver=solver, limit_bytes=int(2.5 * size))
    for albedo in (0.2, 0.3, 0.4):
        store(LAYERS, **(SETTINGS | {"albedo": albedo}))
    assert sum(entry.stat().st_size for entry in tmp_path.iterdir()) <= 2.5 * size
    calls = solver.calls
    store(LAYERS, **(SETTINGS | {"albedo": 0.4}))
    assert solver.calls == calls


def test_the_users_cache_folder_follows_the_convention(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache_folder() == tmp_path / "rigctl" / "skies"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert user_cache_folder() == tmp_path / ".cache" / "rigctl" / "skies"


def test_an_entry_depends_on_all_sources_of_the_solver():
    assert {"solver.py", "layers.py", "mie.py"} <= set(solver_sources())
