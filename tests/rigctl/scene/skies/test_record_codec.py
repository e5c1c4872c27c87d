from dataclasses import dataclass, field

import numpy as np
import pytest

from rigctl.scene.light import NotStorableError, decode, encode, fingerprint


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


KINDS = {"Inner": Inner, "Outer": Outer}


def record(number=1.5):
    inner = Inner(values=np.arange(6.0).reshape(2, 3))
    return Outer(parts=(inner, inner), modes=range(3, 7), number=number, converged=True, nothing=None)


def test_a_record_comes_back_as_it_was():
    found = decode(encode(record()), KINDS)
    np.testing.assert_array_equal(found.parts[0].values, record().parts[0].values)
    assert (found.modes, found.number, found.converged, found.nothing) == (range(3, 7), 1.5, True, None)
    assert found.made == [1.5]


def test_what_was_one_object_is_one_again():
    found = decode(encode(record()), KINDS)
    assert found.parts[0] is found.parts[1]


def test_fingerprints_tell_numbers_apart_and_nothing_else():
    assert fingerprint(record()) == fingerprint(record())
    assert fingerprint(record(1.5)) != fingerprint(record(np.nextafter(1.5, 2.0)))
    changed = Inner(values=np.arange(6.0).reshape(2, 3) + 1e-16 * np.eye(2, 3))
    assert fingerprint(changed) != fingerprint(Inner(values=np.arange(6.0).reshape(2, 3)))
    assert fingerprint(Inner(values=np.zeros((2, 3)))) != fingerprint(Inner(values=np.zeros((3, 2))))


def test_numbers_of_numpy_are_numbers():
    assert decode(encode((np.float64(0.1), np.bool_(True))), {}) == (0.1, True)


def test_what_is_no_record_of_numbers_is_refused():
    with pytest.raises(NotStorableError):
        encode((1.0, object()))


def test_a_class_that_is_not_expected_is_not_made():
    with pytest.raises(KeyError):
        decode(encode(record()), {"Outer": Outer})
