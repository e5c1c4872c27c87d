from pathlib import Path

from rigctl.files.key_reference import reference_page

PAGE = Path(__file__).parents[3] / "docs" / "file-keys.md"


def test_the_page_of_keys_is_what_the_models_check():
    assert PAGE.read_text(encoding="utf-8") == reference_page(), (
        "write it again: python -m rigctl.files.key_reference > docs/file-keys.md"
    )


def test_keys_of_inner_tables_stand_there():
    page = reference_page()
    assert "| `stage.tolerance_deg` | number | above 0, to 5 | `0.02` |  |" in page
    assert "| `[[take]]` | tables |" in page
    assert "`sensor.f_number`" in page
