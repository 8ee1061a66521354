"""``@record``: construction, comparison, copies, and what is refused."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from typing import ClassVar

import pytest

from orinkit.core.record import EMPTY, field_names, record, replaced


@record
class Place:
    """A record with a default, a class variable, and a check."""

    unit: ClassVar[str] = "mm"
    x: float
    y: float = 0.0

    def __post_init__(self) -> None:
        if self.x < 0:
            raise ValueError("x")


@record(kw_only=True)
class Named(Place):
    name: str
    notes: dict[str, str] = EMPTY


@record(eq=False)
class Mark:
    text: str


@record
class Doubled:
    """A record with a constructor of its own."""

    value: int

    def __init__(self, half: int) -> None:
        object.__setattr__(self, "value", 2 * half)


def test_construction_and_text():
    assert (Place(1).x, Place(1).y, Place(y=2, x=1).y, Place.unit) == (1, 0.0, 2, "mm")
    assert repr(Place(1, 2)) == "Place(x=1, y=2)"
    assert repr(Named(1, name="n")) == "Named(x=1, y=0.0, name='n', notes=mappingproxy({}))"
    assert Doubled(4).value == 8
    assert field_names(Named) == ("x", "y", "name", "notes")
    for arguments in ((), (1, 2, 3)):
        with pytest.raises(TypeError):
            Place(*arguments)
    with pytest.raises(TypeError):
        Named(1, 2, "n")
    with pytest.raises(ValueError, match="x"):
        Place(-1)


def test_equality_and_hash():
    assert Place(1) == Place(1.0, 0)
    assert hash(Place(1)) == hash(Place(1))
    assert Place(1) != Place(2)
    assert Place(1) != (1, 0.0)
    assert Mark("a") != Mark("a")


def test_a_record_does_not_change():
    place = Place(1)
    with pytest.raises(AttributeError, match="immutable"):
        place.x = 2
    with pytest.raises(AttributeError, match="immutable"):
        del place.x
    with pytest.raises(AttributeError):
        place.z = 2
    assert place == Place(1)


def test_a_default_that_could_be_changed_is_refused():
    with pytest.raises(TypeError, match="immutable"):

        @record
        class Wrong:
            items: list[int] = []  # noqa: RUF012 - the fault


def test_copies_with_other_values_are_checked():
    assert replaced(Named(1, name="n"), y=5) == Named(1, 5, name="n")
    with pytest.raises(ValueError, match="x"):
        replaced(Place(1), x=-1)
    with pytest.raises(TypeError):
        replaced(Place(1), z=1)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_pickling_and_copying(protocol):
    for each in (Place(1, 2), Doubled(3)):
        assert pickle.loads(pickle.dumps(each, protocol)) == each
        assert copy.copy(each) == copy.deepcopy(each) == each


def test_the_functions_of_dataclasses_accept_records():
    assert dataclasses.is_dataclass(Place)
    assert [each.name for each in dataclasses.fields(Named(1, name="n"))] == ["x", "y", "name", "notes"]
    assert dataclasses.replace(Place(1), y=3) == Place(1, 3)
    assert dataclasses.asdict(Place(1)) == {"x": 1, "y": 0.0}


def test_patterns():
    match Place(1, 2):
        case Place(x, y):
            assert (x, y) == (1, 2)
