"""Formulas that stand inside a sentence of a docstring: "with P_0 = [R, R/T] and level s >= 0".

A formula is read by a small grammar: symbols (single letters, Greek names, words with an index),
numbers, brackets, functions and signs. Only what can be nothing else becomes mathematics: it has
an index, a power, a function, a sign between two symbols, or is a Greek name. Where a formula goes
on with a word that is no symbol, all of it stays text; so do shapes, as (T, D), and units.
"""

import re

from .mathematics import LETTERS, one_line

FUNCTIONS = (
    "exp log ln sin cos tan atan2 max min det sqrt sum prod diag blkdiag erf tr Cov Var Pr"
).split()
OF_ONE = "exp log ln sin cos tan det".split()
"""Functions whose argument may stand behind a blank: log q."""
GREEK = set(LETTERS)
NAMES = "dT dt dw dv da KL E".split()
WORDS = "tail rate margin level speed weight risk radius horizon acceleration perimeter".split()
"""Parameters that formulas name by a word; symbols only beside a sign or inside brackets."""
UNIT = re.compile(r"(?:rad|Hz|m|s|1)(?:\^-?[12])?(?:/(?:rad|m|s|h)(?:\^\d)?)*(?![\w^(])")
A_UNIT = re.compile(
    r"\(?(?:[\d.]+ )?(?:rad|m|s|1)(?:\^-?\d)?(?:/(?:rad|m|s)(?:\^\d)?)*\)?(?:\^\d)?"
)
SHAPE = re.compile(r"[A-Z\d *+-]+")
GAP = re.compile(r" +|\n +(?![-*] )|\n(?![-* \n])")
SIGN = re.compile(r"<=|>=|<-|->(?! *\()|\.\.|\.(?= )|[=<>+*/~]|-(?!>)")
INDEX = re.compile(r"_(?:\{[^{}]*\}|\([a-z]\)(?:,[a-z]+)?|-?[A-Za-z]+(?:,[a-z]+)*|\d+)")
POWER = re.compile(r"\^(?:\{[^{}]*\}|\([^()]*\)|-?\d+(?:/\d+)?|-?[A-Za-z]|\*)")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e-?\d+)?(?:a?b?|[KD])(?!\w|\.\w)")
WORD = re.compile(r"[A-Za-z]+")
BRACKETS = {"(": ")", "[": "]"}
STARTS = re.compile(r"(?<![\w\\.'/-])[A-Za-z]+|(?<![\w\\])\d|(?<![\w)\]`])[(\[|]")


class Reader:
    """Reads one formula from a position on; ``proof`` is set by what is no plain text."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.proof = False

    def formula(self, at: int, inside: bool = False) -> int:
        """Return the end of the longest formula that starts here, or -1."""
        end = self.operand(at, inside)
        while end >= 0:
            gap = GAP.match(self.text, end)
            after = gap.end() if gap else end
            sign = SIGN.match(self.text, after)
            if sign:
                spaced = bool(gap) and GAP.match(self.text, sign.end())
                if sign[0] == "." and not gap:
                    return end
                if sign[0] == "->" and self.text[end - 1] == ")" and not self.proof:
                    return end  # from shape to shape
                if sign[0] == "-" and not (spaced or inside or self.text[end - 1] in "N)"):
                    return end
                behind = GAP.match(self.text, sign.end())
                more = self.operand(behind.end() if behind else sign.end(), True)
                if more < 0:
                    return end
                self.proof = True
            else:
                more = self.operand(after, inside) if gap or inside else -1
                unit = UNIT.match(self.text, after)
                if unit and re.match(r"[)\],]| [a-z]{2}", self.text[unit.end() :]):
                    behind_number = re.search(r"(?:^|[\s(=<>~+*/-])[\d.]+\Z", self.text[:end])
                    if behind_number or self.text[end - 1] in ")]":
                        return end
                if more < 0 or (not inside and not self.joins(end, after, more)):
                    return end
            end = more
        return end

    def joins(self, before: int, at: int, end: int) -> bool:
        """Whether what follows after a blank alone is a factor of a product: no unit, no word."""
        text, next_one = self.text, self.text[at:end]
        if re.search(r"(?:^|[\s(=<>~+*/-])[\d.]+\Z", text[:before]) and UNIT.match(text, at):
            return False
        if next_one == "a":
            return bool(re.match(r" (?:[b-z]\b|[-+*/=<>])", text[end:]))
        if next_one[0] in "([":
            if re.search(r"[<>=] ?[\d.]+\Z", text[:before]):
                return False  # a relation ends there
            return bool(re.search(r"[-+*/=<>_^]", next_one))
        return not next_one[0].isdigit()

    def operand(self, at: int, named: bool) -> int:
        """Return the end of a symbol, number, bracket or function, or -1.

        Parameters
        ----------
        named : whether a word of `WORDS` counts as a symbol.
        """
        text = self.text
        if named and text.startswith("-", at):
            at += 1
        if number := NUMBER.match(text, at):
            blank = text.startswith(" ", number.end())
            if blank and UNIT.match(text, number.end() + 1) and not named:
                return number.end()
            return self.attached(number.end())
        if text.startswith("|", at):
            end = self.formula(at + 1, True)
            return self.attached(end + 1) if end > 0 and text.startswith("|", end) else -1
        if at < len(text) and text[at] in BRACKETS:
            end = self.listed(at)
            while end > 0 and text.startswith("(", end):
                end = self.listed(end)
            return self.attached(end) if end > 0 else -1
        word = WORD.match(text, at)
        if word is None:
            return -1
        return self.symbol(word, named)

    def symbol(self, word: re.Match[str], named: bool) -> int:
        """Return the end of a symbol with its index, power and arguments, or -1."""
        text, name, end = self.text, word[0], word.end()
        follows = text[end : end + 1]
        index = INDEX.match(text, end)
        if name in FUNCTIONS:
            if index and len(index[0]) > 3 and "{" not in index[0]:
                return -1
            if follows not in ("(", "[") and not index:
                if follows != " " or not (named or name in OF_ONE):
                    return -1
                more = self.operand(end + 1, named)
                if more < 0 or text[end + 1 : more] in ("a", "I"):
                    return -1
                end = more
            self.proof = True
        elif name in GREEK:
            self.proof = True
        elif len(name) == 1 or name in NAMES:
            pass
        elif index and len(index[0]) == 2:
            pass
        elif name not in WORDS or index or not (named or follows == "^"):
            return -1
        end = self.attached(end)
        if text[end : end + 1] in ("(", "["):
            more = self.listed(end)
            if more < 0 or (len(name) > 1 and name not in (*FUNCTIONS, *GREEK, *NAMES)):
                return -1
            self.proof = True
            end = self.attached(more)
        return end

    def listed(self, at: int) -> int:
        """Return the end of a bracket with formulas between commas, or -1."""
        text, closing = self.text, BRACKETS[self.text[at]]
        before, self.proof = self.proof, False
        end, count = at, 0
        while True:
            gap = GAP.match(text, end + 1)
            end = self.formula(gap.end() if gap else end + 1, True)
            if end < 0:
                self.proof = before
                return -1
            count += 1
            if text.startswith(closing, end):
                break
            if not text.startswith((",", "; "), end):
                self.proof = before
                return -1
        inner = text[at : end + 1]
        greek = any(word in GREEK or word in FUNCTIONS for word in WORD.findall(inner))
        self.proof = before or (self.proof if count == 1 else "_" in inner or greek)
        return end + 1

    def attached(self, at: int) -> int:
        """Return the end of the indices, powers and primes that follow."""
        while at < len(self.text):
            found = INDEX.match(self.text, at) or POWER.match(self.text, at)
            prime = re.compile(r"'(?![a-z]*s\b|[a-z])").match(self.text, at)
            if found is None and prime is None:
                return at
            self.proof = self.proof or found is not None
            at = (found or prime).end()  # type: ignore[union-attr]
        return at


def split(text: str, symbols: frozenset[str] = frozenset()) -> list[str]:
    """Return text, formula, text, ...: what stands between two texts is LaTeX.

    Parameters
    ----------
    text : prose without code.
    symbols : letters that the docstring's formulas use, which are set as such where they stand
        alone.
    """
    found, done, at = [], 0, 0
    while match := STARTS.search(text, at):
        begin, at = match.start(), match.end()
        reader = Reader(text)
        end = reader.formula(begin)
        if end < 0:
            if match[0].isalpha() and text.startswith("(", at):
                at = after_bracket(text, at)
            elif match[0] == "[":
                at = after_bracket(text, begin)
            continue
        at = max(end, at)
        inner = text[begin:end]
        alone = inner in symbols and inner not in "aAIms"
        symbolic = re.search(r"(?<![\d.])[A-Za-z]", inner) and not A_UNIT.fullmatch(inner)
        if not whole(text, begin, end):
            if "_" in inner or goes_on(text, end):
                rest = re.compile(r"[,;:]|\.\s|\n\n|\Z").search(text, end)
                at = rest.start() if rest else end
        elif alone or (reader.proof and symbolic):
            found += [text[done:begin], one_line(" ".join(inner.split())).strip()]
            done = end
    return [*found, text[done:]]


def whole(text: str, begin: int, end: int) -> bool:
    """Whether nothing beside a formula belongs to it."""
    before, after = text[:begin], text[end:]
    sign_before = r"(?:[=<>+/~^|*]|\S -|\.\.| \.|\b(?:max|min|sum)) *\Z"
    if re.search(sign_before + r"|[\w/^`]\Z|[\w.]-\Z", before):
        return False
    if text[begin:end] in GREEK and re.match(r" (?:method|points?|distribution)\b", after):
        return False
    if re.search(r"_\w+_", text[begin:end]):  # a name of code
        return False
    if SHAPE.fullmatch(text[begin:end]) and before.endswith(("(", ", ")) and after[:1] in ",)":
        return False
    return not goes_on(text, end) and not re.match(r"[\w(\[^|'/]|-\w|\.\w", after)


def goes_on(text: str, end: int) -> bool:
    """Whether a sign follows, so that the formula goes on with what could not be read."""
    return bool(re.match(r"\s*(?:<=|>=|<-|->|[=<>+~/*^]|\.\.)| [-:] ", text[end:]))


def after_bracket(text: str, at: int) -> int:
    """Return the place after the bracket that opens here."""
    depth, pair = 0, (text[at], BRACKETS[text[at]])
    for end in range(at, len(text)):
        depth += (text[end] == pair[0]) - (text[end] == pair[1])
        if not depth:
            return end + 1
    return len(text)


def letters(formulas: list[str]) -> frozenset[str]:
    """Return the single letters that formulas use as symbols."""
    plain = re.sub(r"\\mathrm\{\w+\}|\\[A-Za-z]+", " ", " ".join(formulas))
    return frozenset(re.findall(r"(?<![A-Za-z])[A-Za-z](?![A-Za-z])", plain))
