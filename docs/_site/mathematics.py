"""From an equation in plain text, as docstrings have it, to LaTeX.

s_{k+1} = F s_k + w,  w ~ N(0, Q)   becomes   s_{k+1} = F s_k + w, \\quad w \\sim N(0, Q)
"""

import re

LETTERS = (
    "alpha beta gamma delta epsilon eps theta kappa lambda lam mu pi rho sigma tau phi psi chi "
    "omega Gamma Delta Theta Lambda Sigma Phi Psi Omega"
).split()
FUNCTIONS = "exp log ln sin cos tan max min det Pr".split()
OTHER_NAMES = {
    "eps": r"\varepsilon", "lam": r"\lambda", "sum": r"\sum", "prod": r"\prod", "int": r"\int",
    "grad": r"\nabla", "phi": r"\varphi", "gap": r"\mathrm{gap}", "dW": "dW",
    "tr": r"\operatorname{tr}",
}  # fmt: skip
SIGNS = {
    "<=": r"\le ", ">=": r"\ge ", "->": r"\to ", "<-": r"\leftarrow ", "+-": r"\pm ",
    "~": r"\sim ", "*": r"\cdot ", "{": r"\{", "}": r"\}", "%": r"\%", "&": r"\&",
    "#": r"\#",
}  # fmt: skip
TOKEN = re.compile(
    r"(?P<space> {2,})|(?P<blank> )|(?P<word>[A-Za-z]+)|(?P<number>\d+(?:\.\d+)?)"
    r"|(?P<sign><=|>=|->|<-|\+-|.)"
)


def latex(block: list[str]) -> str:
    """Return a block of equations, one per line, as LaTeX."""
    lines = [line.rstrip() for line in block]
    if len(lines) == 1:
        return one_line(lines[0].strip())
    least = min(len(line) - len(line.lstrip()) for line in lines)
    rows = []
    for line in lines:
        indent = len(line) - len(line.lstrip()) - least
        rows.append("& " + r"\quad " * bool(indent) + one_line(line.strip()))
    return "\\begin{aligned}\n" + " \\\\\n".join(rows) + "\n\\end{aligned}"


def one_line(text: str) -> str:
    """Return one equation as LaTeX."""
    return "".join(translated(text.replace(" . ", " * ")))


def translated(text: str) -> list[str]:
    """Return the parts of an equation, with roots, indices and powers in braces."""
    found, position = [], 0
    while position < len(text):
        if match := re.compile(r"sqrt ?(\d)").match(text, position):
            found.append(rf"\sqrt{{{match[1]}}} ")
            position = match.end()
            continue
        if text.startswith("sqrt(", position):
            inner, position = bracketed(text, position + 4)
            found.append(rf"\sqrt{{{one_line(inner)}}}")
            continue
        if text[position] in "_^" and position + 1 < len(text):
            inner, position = attached(text, position)
            found.append(inner)
            continue
        match = TOKEN.match(text, position)
        assert match is not None
        starred = match[0] == "*" and (position + 1 == len(text) or text[position + 1] in " |)-")
        after_blank = position == 0 or text[position - 1] == " "
        found.append("^*" if starred and not after_blank else piece(match))
        position = match.end()
    return found


def attached(text: str, position: int) -> tuple[str, int]:
    """Return an index or power with braces around it, and the position after it."""
    mark, following = text[position], text[position + 1]
    if listed := re.compile(r"(\([a-z]\),[a-z]+)").match(text, position + 1):
        return f"{mark}{{{listed[1]}}}", listed.end()
    if following in "({":
        inner, end = bracketed(text, position + 1)
        return f"{mark}{{{one_line(inner)}}}", end
    match = re.compile(r"-?(?:[A-Za-z]+|\d+)(?:,[a-z]+)*|\*").match(text, position + 1)
    if match is None:
        return mark, position + 1
    inner = match[0]
    plain = re.fullmatch(r"-?[a-z]{1,2}\d?|-?\d+|[A-Z]|\*", inner)
    words = [inner] if plain else [word_of(word) for word in inner.split(",")]
    return f"{mark}{{{','.join(words)}}}", match.end()


def bracketed(text: str, position: int) -> tuple[str, int]:
    """Return what stands between the bracket at ``position`` and its partner, and the end."""
    pairs = {"(": ")", "{": "}"}
    opening, closing, depth = text[position], pairs[text[position]], 0
    for end in range(position, len(text)):
        depth += (text[end] == opening) - (text[end] == closing)
        if not depth:
            return text[position + 1 : end], end + 1
    return text[position + 1 :], len(text)


def word_of(word: str) -> str:
    """Return a word of an equation: Greek, a function, a variable, or text."""
    if word in OTHER_NAMES:
        return OTHER_NAMES[word] + " "
    if word in LETTERS:
        return f"\\{word} "
    if word in FUNCTIONS:
        return f"\\{word} "
    if len(word) == 1 or word.isdigit() or word.startswith("-"):
        return word
    if len(word) == 2 and word[0].islower() and word[1].islower() and word not in WORDS:
        return word
    return rf"\mathrm{{{word}}}"


WORDS = {"in", "is", "of", "to", "at", "by", "or", "if"}


def piece(match: re.Match[str]) -> str:
    """Return one token."""
    if match["space"]:
        return r"\quad "
    if match["blank"]:
        return r"\ " if between_words(match) else " "
    if match["word"]:
        return word_of(match["word"])
    return SIGNS.get(match[0], match[0])


def between_words(match: re.Match[str]) -> bool:
    """Whether a blank separates two words of text, where LaTeX would swallow it."""
    text = match.string
    before = re.search(r"([A-Za-z]+)$", text[: match.start()])
    after = re.match(r"[A-Za-z]+", text[match.end() :])
    sides = [side[0] for side in (before, after) if side]
    return any(word_of(side).startswith(r"\mathrm") for side in sides)
