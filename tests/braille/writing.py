"""Print as Braille: what plates of the tests show."""

from roller_braille.table import (
    CAPITAL_SIGN,
    DIGITS,
    LETTER_SIGN,
    LETTERS,
    NUMBER_SIGN,
    PUNCTUATION,
    SPACE,
)

OPENING, CLOSING = 0b100110, 0b110100


def to_masks(text: str) -> list[int]:
    """Masks of the cells of one line of print: letters, digits, spaces, the table's punctuation."""
    out: list[int] = []
    number = capitals = False
    for i, c in enumerate(text):
        if number and c not in DIGITS and c not in ".,":
            number = False
            if c.lower() in LETTERS and c.lower() <= "j":
                out.append(LETTER_SIGN)
        if capitals and not (c.isalpha() and c.isupper()):
            capitals = False
        if c in DIGITS:
            if not number:
                out.append(NUMBER_SIGN)
            number = True
            out.append(DIGITS[c])
        elif c == " ":
            out.append(SPACE)
        elif c.lower() in LETTERS:
            if c.isupper() and not capitals:
                at_start = i == 0 or not text[i - 1].isalpha()
                capitals = at_start and _is_capital_run(text[i:])
                out += [CAPITAL_SIGN] * (2 if capitals else 1)
            out.append(LETTERS[c.lower()])
        elif c == '"':
            out.append(OPENING if not out or out[-1] == SPACE else CLOSING)
        elif c in PUNCTUATION:
            out.append(PUNCTUATION[c])
        else:
            raise ValueError(c)
    return out


def _is_capital_run(text: str) -> bool:
    """Whether a text begins with two capitals or more and no small letter joined to them."""
    run = 0
    while run < len(text) and text[run].isalpha() and text[run].isupper():
        run += 1
    return run > 1 and not (run < len(text) and text[run].isalpha())
