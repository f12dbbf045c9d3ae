"""Grade 1 Braille: letters, digits, capitals, punctuation and spaces.

Every cell stands for itself, as in uncontracted Unified English Braille (UEB). A cell is a mask:
dot 1 is bit 0 … dot 6 is bit 5, dots 1-2-3 down the left column and 4-5-6 down the right one.

======================  =========================================================================
cells                   meaning
======================  =========================================================================
a–j                     dots 1, 2, 4, 5
k–t                     a–j and dot 3
u, v, x, y, z           a–e and dots 3, 6; w is dots 2-4-5-6
``, ; : . ! ? ' -``     dots 2, 2-3, 2-5, 2-5-6, 2-3-5, 2-3-6, 3, 3-6
``"``                   dots 2-3-6 at the start of a word, 3-5-6 elsewhere
3-4-5-6                 number sign: a–j that follow are 1–9 and 0, with ``.`` and ``,`` among them,
                        up to a space or any other cell
6                       capital sign: the letter that follows; twice: the word that follows
6, 3                    end of capitals within a word, as in PCBs
5-6                     letter sign: what follows is a letter, not a digit
4, 5, 4-5, 4-6, 4-5-6   prefixes: what follows is no letter but part of a symbol that isn't read
none                    space
======================  =========================================================================
"""

from __future__ import annotations

NUMBER_SIGN = 0b111100
CAPITAL_SIGN = 0b100000
LETTER_SIGN = 0b110000
SPACE = 0
#: Dots 4, 5, 4-5, 4-6 and 4-5-6: with the cell behind one they make up a symbol of two cells.
PREFIXES = frozenset({0b001000, 0b010000, 0b011000, 0b101000, 0b111000})
#: Stands in texts for a cell whose dots are not certain.
UNREADABLE = "\N{REPLACEMENT CHARACTER}"


def _mask(dots: str) -> int:
    return sum(1 << (int(d) - 1) for d in dots)


_A_TO_J = tuple(_mask(d) for d in "1 12 14 145 15 124 1245 125 24 245".split())


def _letters() -> dict[str, int]:
    masks = dict(zip("abcdefghij", _A_TO_J, strict=True))
    masks |= {c: m | _mask("3") for c, m in zip("klmnopqrst", _A_TO_J, strict=True)}
    masks |= {c: m | _mask("36") for c, m in zip("uvxyz", _A_TO_J[:5], strict=True)}
    # Braille's own French alphabet had no w.
    masks["w"] = _mask("2456")
    return masks


#: Mask of each letter.
LETTERS = _letters()
#: Mask of each digit after a number sign.
DIGITS = dict(zip("1234567890", _A_TO_J, strict=True))
#: Mask of each punctuation mark with one meaning.
PUNCTUATION = {
    c: _mask(d)
    for c, d in {
        ",": "2",
        ";": "23",
        ":": "25",
        ".": "256",
        "!": "235",
        "?": "236",
        "'": "3",
        "-": "36",
    }.items()
}
_OPENING, _CLOSING = _mask("236"), _mask("356")
_LETTER_OF_MASK = {m: c for c, m in LETTERS.items()}
_OF_MASK = _LETTER_OF_MASK | {m: c for c, m in PUNCTUATION.items()} | {_CLOSING: '"'}
_TERMINATOR = PUNCTUATION["'"]
_DIGIT_OF_MASK = {m: c for c, m in DIGITS.items()}
_IN_NUMBERS = {PUNCTUATION["."]: ".", PUNCTUATION[","]: ","}


def pattern(mask: int) -> str:
    """The Unicode Braille pattern of a mask."""
    return chr(0x2800 + mask)


class Decoder:
    """Reads the cells of one line in order; what a cell stands for depends on those before it."""

    def __init__(self) -> None:
        self._number = self._prefix = False
        self._doubtful = False
        self._capital = self._capitals = False
        self._last = SPACE

    def read(self, mask: int) -> str | None:
        """What the next cell stands for.

        Returns
        -------
        str or None
            A character; empty for a sign that has none of its own; None when the table has no
            meaning for the cell, or none that is certain here.
        """
        previous, self._last = self._last, mask
        if mask == SPACE:
            self.__init__()  # type: ignore[misc]
            return " "
        behind_prefix, self._prefix = self._prefix, mask in PREFIXES
        if behind_prefix:
            self._number = self._capital = self._capitals = False
            return None
        if mask in (NUMBER_SIGN, LETTER_SIGN, CAPITAL_SIGN):
            self._number, self._doubtful = mask == NUMBER_SIGN, False
            if mask == CAPITAL_SIGN:
                self._capitals = self._capital
                self._capital = True
            elif mask == NUMBER_SIGN:
                # Capitals reach to the end of the letters.
                self._capital = self._capitals = False
            return ""
        if mask in _DIGIT_OF_MASK and self._doubtful:
            return None
        if self._number and mask in _DIGIT_OF_MASK:
            return _DIGIT_OF_MASK[mask]
        if self._number and mask in _IN_NUMBERS:
            return _IN_NUMBERS[mask]
        self._number = self._doubtful = False
        if self._capital and mask not in _LETTER_OF_MASK:
            # With the capital sign it ends capitals, or makes up a symbol of two cells.
            self._capital = self._capitals = False
            return "" if mask == _TERMINATOR else None
        if mask == _OPENING and previous == SPACE:
            return '"'
        found = _OF_MASK.get(mask)
        if found is None or not found.isalpha():
            self._capital = self._capitals = False
            return found
        if self._capital or self._capitals:
            found = found.upper()
        self._capital = False
        return found

    def skip(self, mask: int, certain: int) -> None:
        """Pass a cell that could not be read.

        If it may have begun or ended a number, whether the cells after it are digits or letters
        stays open up to the next space.

        Parameters
        ----------
        mask : int
            Its dots as far as seen.
        certain : int
            Mask of the dots that are certain, raised or not.
        """
        may_be_sign = (mask ^ NUMBER_SIGN) & certain == 0
        self._doubtful = self._doubtful or self._number or may_be_sign
        self._number = self._capital = self._capitals = self._prefix = False
        self._last = mask or 1
