"""The pages of the reference that are made from the code."""

import tomllib
from dataclasses import fields
from typing import Annotated, Any, get_args

import pytest
from pydantic import TypeAdapter

from docs import reference_pages
from model.effects.planner import EFFECTS
from rigctl import console
from rigctl.files.session_file import InterlockSection
from rigctl.runs.records import FrameRecord
from rigctl.session.interlocks import Name


def test_every_key_has_a_meaning_and_an_example_that_its_model_accepts():
    problems = [
        f"{title}: {problem}"
        for title, keys in reference_pages.file_keys()
        for key in keys
        for problem in _problems(key)
    ]
    assert problems == [], "write it under the field of the model, as its neighbours do"


def _problems(key):
    if not key.meaning:
        yield f"{key.shown} has no meaning"
    if not key.example and not key.is_table:
        yield f"{key.shown} has no example"
    if key.example:
        given = tomllib.loads(f"example = {key.example}")["example"]
        kind: Any = key.field.annotation
        for mark in key.field.metadata:
            kind = Annotated[kind, mark]
        try:
            TypeAdapter(kind).validate_python(given)
        except ValueError as error:
            yield f"{key.shown}: {key.example}: {error}"


def test_the_page_of_keys_has_types_ranges_defaults_and_inner_tables():
    page = reference_pages.keys_page()
    assert "| `0.02` | number | deg | above 0, to 5 | `0.02` |" in page
    assert "| `[[take]]` | " in page
    assert "`sensor.f_number`" in page
    assert "| `effects.with` | " in page, "as the file has it, not the program"


def test_the_page_of_parameters_has_units_and_ranges():
    page = reference_pages.parameters_page()
    assert "| `sun.zenith_deg` | deg | 0 to 89 | " in page
    assert "| `noise.prnu` | 1 | from 0 | " in page


def test_the_page_of_frames_has_every_field_of_a_record():
    page = reference_pages.frames_page()
    assert all(f"| `{field.name}` | " in page for field in fields(FrameRecord))


def test_the_page_of_codes_has_every_exit_code_interlock_flag_check_and_effect():
    page = reference_pages.codes_page()
    codes = [value for name, value in vars(console).items() if name.startswith("EXIT_") and isinstance(value, int)]
    assert all(f"\n| {code} | " in page for code in codes)
    assert all(f"\n| `{name}` | `" in page for name in InterlockSection.model_fields)
    assert all(name in InterlockSection.model_fields for name in get_args(Name))
    assert all(f"\n| {effect.value} | `" in page for effect in EFFECTS)
    flags = page[page.index("## Flags") : page.index("## Checks")]
    assert flags.count("\n| `") > 50
    assert "; refuses |" in flags
    checks = page[page.index("## Checks") : page.index("## Effects")]
    assert checks.count("\n| ") > 8


@pytest.mark.parametrize("name", ["black-paint", "asphalt", "rural"])
def test_the_page_of_materials_has_materials_and_aerosols(name):
    assert f"`{name}`" in reference_pages.materials_page()
