from __future__ import annotations

import pytest

from roller_bringup.launching.substitutions import Call, SubstitutionError, expand, parse


def echo(name, arguments):
    return f"<{name}:{'|'.join(arguments)}>"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ""),
        ("plain text, (with) $signs", "plain text, (with) $signs"),
        ("$(var a)", "<var:a>"),
        ("x$(var a)y$(dirname)", "x<var:a>y<dirname:>"),
        ("$(var a b)", "<var:a|b>"),
        ("$(env A $(find-pkg-share p)/x.xml)", "<env:A|<find-pkg-share:p>/x.xml>"),
        ("$(var when_$(var method) method)", "<var:when_<var:method>|method>"),
        ("$(env A 'two words')", "<env:A|two words>"),
        ("$(env A '')", "<env:A|>"),
        ('$(env A "it $(var b)")', "<env:A|it <var:b>>"),
        (r"\$(var a)", "$(var a)"),
        (r"a\\b", r"a\b"),
    ],
)
def test_texts(text, expected):
    assert expand(parse(text), echo) == expected


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("$(eval 1 + 1)", "not supported"),
        ("$(find-pkg-prefix a)", "not supported"),
        ("$()", "not supported"),
        ("$(var a", "not closed"),
        ("$(var)", "takes 1 or 2 arguments, not 0"),
        ("$(dirname a)", "takes 0 arguments"),
        ("$(find-pkg-share a b)", "takes 1 arguments, not 2"),
        ("$(env A 'open)", "quote"),
        ("$(var  a)", "empty"),
    ],
)
def test_refuses(text, reason):
    with pytest.raises(SubstitutionError, match=reason.replace("(", r"\(")):
        parse(text)


def test_pieces():
    assert parse("a$(var b)") == ("a", Call("var", (("b",),)))
