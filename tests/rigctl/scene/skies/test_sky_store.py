import numpy as np
import pytest

from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.layers import AerosolKind, Layer
from model.atmosphere.solver import solve
from rigctl.scene.light import SkyStore, solver_sources, user_cache_folder

LAYERS = (Layer(tau_rayleigh=0.05, tau_aerosol=0.1, ssa_aerosol=0.9, g_aerosol=0.6, delta=0.96),)
SETTINGS = {"mu0": 0.7, "albedo": 0.1, "nodes": 4, "element_depth": 0.1, "tolerance": 1e-3}


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


def test_a_second_run_takes_what_the_first_computed(tmp_path, solver):
    first = SkyStore(tmp_path, solver=solver)(LAYERS, **SETTINGS)
    again = SkyStore(tmp_path, solver=solver)
    np.testing.assert_array_equal(light(again(LAYERS, **SETTINGS)), light(first))
    assert (solver.calls, again.taken, again.computed) == (1, 1, 0)


@pytest.mark.parametrize("change", [{"mu0": 0.7000001}, {"albedo": 0.2}, {"aerosol": "polarizing"}, {"nodes": 5}])
def test_other_inputs_are_another_sky(tmp_path, solver, change):
    store = SkyStore(tmp_path, solver=solver)
    store(LAYERS, **SETTINGS)
    store(LAYERS, **(SETTINGS | change))
    assert solver.calls == 2


def _only_entry(folder):
    (entry,) = folder.iterdir()
    return entry


def _flip_a_bit(data):
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


@pytest.mark.parametrize(
    "spoil", [_flip_a_bit, lambda data: data[:-10], lambda data: b"", lambda data: data.replace(b"sky 1", b"sky 2", 1)]
)
def test_a_damaged_entry_is_computed_anew_and_replaced(tmp_path, solver, spoil):
    right = light(SkyStore(tmp_path, solver=solver)(LAYERS, **SETTINGS))
    entry = _only_entry(tmp_path)
    whole = entry.read_bytes()
    entry.write_bytes(spoil(whole))
    store = SkyStore(tmp_path, solver=solver)
    np.testing.assert_array_equal(light(store(LAYERS, **SETTINGS)), right)
    assert solver.calls == 2
    assert any("damaged" in remark for remark in store.remarks)
    assert entry.read_bytes() == whole


def test_an_entry_with_a_right_checksum_that_holds_no_sky_is_not_trusted(tmp_path, solver):
    import hashlib

    SkyStore(tmp_path, solver=solver)(LAYERS, **SETTINGS)
    body = b"no archive"
    _only_entry(tmp_path).write_bytes(
        b"rigctl sky 1 sha256 " + hashlib.sha256(body).hexdigest().encode() + b"\n" + body
    )
    SkyStore(tmp_path, solver=solver)(LAYERS, **SETTINGS)
    assert solver.calls == 2


def test_a_folder_that_cannot_be_written_costs_time_only(tmp_path, solver):
    blocked = tmp_path / "file"
    blocked.write_text("here stands a file")
    store = SkyStore(blocked / "skies", solver=solver)
    store(LAYERS, **SETTINGS)
    assert solver.calls == 1
    assert any("cannot be" in remark for remark in store.remarks)


def test_a_full_folder_loses_what_was_not_used_for_longest(tmp_path, solver):
    SkyStore(tmp_path, solver=solver)(LAYERS, **SETTINGS)
    size = _only_entry(tmp_path).stat().st_size
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


def test_a_sky_with_scattering_matrices_is_kept_too(tmp_path, solver):
    layers = column(AtmosphereState(visibility_m=23e3), wavelength_m=550e-9).layers(
        fine=False, aerosol=AerosolKind.SPHERES
    )
    settings = SETTINGS | {"aerosol": AerosolKind.SPHERES}
    first = SkyStore(tmp_path, solver=solver)(layers, **settings)
    again = SkyStore(tmp_path, solver=solver)
    np.testing.assert_array_equal(light(again(layers, **settings)), light(first))
    assert (solver.calls, again.remarks) == (1, [])


def test_the_solver_that_an_entry_depends_on_is_all_of_its_sources():
    found = solver_sources()
    assert {"solver.py", "layers.py", "mie.py"} <= set(found)
