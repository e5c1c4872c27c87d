"""Options that verbs share."""

import pytest

from rigctl import cli
from rigctl.verbs.headings import HEADINGS

VERBS = [name for verbs in HEADINGS.values() for name, (target, _) in verbs.items() if target not in (None, "old")]


@pytest.mark.parametrize("verb", VERBS)
def test_every_argument_and_option_has_a_line_of_help(verb):
    app = cli.make_app(verb)
    for word in verb.split():
        app = app[word]
    found = app.assemble_argument_collection(parse_docstring=True)
    assert [argument.name for argument in found if argument.show and not argument.parameter.help] == []
