from __future__ import annotations

import pytest

from roller_bringup.launching.substitutions import Call, SubstitutionError, equal, expand, parse


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
        ("$(equals $(var a) b)", "<equals:<var:a>|b>"),
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
        ("$(equals a)", "takes 2 arguments, not 1"),
        ("$(equals a b c)", "takes 2 arguments, not 3"),
        ("$(env A 'open)", "quote"),
        ("$(var  a)", "empty"),
    ],
)
def test_refuses(text, reason):
    with pytest.raises(SubstitutionError, match=reason.replace("(", r"\(")):
        parse(text)


def test_pieces():
    assert parse("a$(var b)") == ("a", Call("var", (("b",),)))


@pytest.mark.parametrize(
    ("left", "right", "same"),
    [
        ("surface", "surface", True),
        ("surface", "Surface", False),
        ("", "surface", False),
        ("", "", True),
        ("two words", "two words", True),
        # Truth values and numbers count by their values, as in launch's EqualsSubstitution.
        ("True", "1", True),
        ("false", "true", False),
        ("2", "2.0", True),
        ("1", "1.0", True),
        ("2", "2.1", False),
        ("1", "one", False),
    ],
)
def test_equal(left, right, same):
    assert equal(left, right) is same
    assert equal(right, left) is same
