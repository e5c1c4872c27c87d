import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import TypeAdapter

from rigctl.files.key_reference import file_keys, reference_page

PAGE = Path(__file__).parents[3] / "docs" / "file-keys.md"


def test_the_page_of_keys_is_what_the_models_check():
    assert PAGE.read_text(encoding="utf-8") == reference_page(), (
        "write it again: python -m rigctl.files.key_reference > docs/file-keys.md"
    )


def test_every_key_has_a_meaning_and_an_example_that_its_model_accepts():
    problems = [problem for title, keys in file_keys() for key in keys for problem in _problems(f"{title}: ", key)]
    assert problems == [], "say it under the field, as its neighbours do"


def _problems(title, key):
    if not key.meaning:
        yield f"{title}{key.shown} has no meaning"
    if not key.example and not key.is_table:
        yield f"{title}{key.shown} has no example"
    if key.example:
        given = tomllib.loads(f"example = {key.example}")["example"]
        kind: Any = key.field.annotation
        for mark in key.field.metadata:
            kind = Annotated[kind, mark]
        try:
            TypeAdapter(kind).validate_python(given)
        except ValueError as error:
            yield f"{title}{key.shown}: {key.example}: {error}"


def test_keys_of_inner_tables_stand_there():
    page = reference_page()
    assert "| `0.02` | number | deg | above 0, to 5 | `0.02` |" in page
    assert "| `[[take]]` | " in page
    assert "`sensor.f_number`" in page
    assert "| `effects.with` | " in page, "as the file has it, not the program"
