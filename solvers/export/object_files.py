"""Object files of Linux without a tool: what they define and want, and archives of them.

What a linker takes as a static library is a row of object files behind a list of the functions
that they define. Both formats are short; nothing but Python writes them here, so that code for
another processor is packed on a machine that has no compiler.

References
----------
Tool Interface Standard, Executable and Linking Format specification, version 1.2 (1995);
System V Application Binary Interface, chapter 7, "Archive file".
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass

from ...framework.values.errors import WideberthError

_MAGIC = b"\x7fELF\x02\x01"
"""ELF of 64 bits, the lowest byte of a number first."""
_SECTION = struct.Struct("<IIQQQQIIQQ")
_SYMBOL = struct.Struct("<IBBHQQ")
_SYMBOLS = 2
_GLOBAL = 1


@dataclass(frozen=True)
class _Symbol:
    """A symbol: its name, whether others see it, and whether they find it here."""

    name: str
    visible: bool
    here: bool


def defined(code: bytes) -> tuple[str, ...]:
    """Names that an object file defines for others.

    Raises
    ------
    WideberthError : no object file of 64-bit Linux.
    """
    return tuple(one.name for one in _symbols(code) if one.visible and one.here)


def wanted(code: bytes) -> tuple[str, ...]:
    """Names that an object file wants from others, in the order of the alphabet.

    Raises
    ------
    WideberthError : no object file of 64-bit Linux.
    """
    return tuple(sorted(one.name for one in _symbols(code) if not one.here))


def _symbols(code: bytes) -> list[_Symbol]:
    """All symbols with a name."""
    if code[: len(_MAGIC)] != _MAGIC:
        raise WideberthError("this is no object file of 64-bit Linux (ELF)")
    (first,) = struct.unpack_from("<Q", code, 40)
    size, count = struct.unpack_from("<HH", code, 58)
    headers = [first + k * size for k in range(count)]
    for header in headers:
        _, kind, _, _, begin, length, link, *_ = _SECTION.unpack_from(code, header)
        if kind != _SYMBOLS:
            continue
        texts = _SECTION.unpack_from(code, headers[link])[4]
        found = []
        for place in range(begin, begin + length, _SYMBOL.size):
            name, info, _, where, *_ = _SYMBOL.unpack_from(code, place)
            text = code[texts + name : code.index(b"\0", texts + name)]
            if text:
                found.append(_Symbol(text.decode(), info >> 4 == _GLOBAL, where != 0))
        return found
    raise WideberthError("this object file has no symbols")


def archive(members: Mapping[str, bytes]) -> bytes:
    """Return a static library of object files by name; the same files give the same bytes.

    Raises
    ------
    WideberthError : no object file of 64-bit Linux, or a name of more than 15 letters.
    """
    long = [name for name in members if len(name) > 15]
    if long:
        raise WideberthError(f"names {long} are too long for an archive; wanted up to 15 letters")
    symbols = {name: defined(code) for name, code in members.items()}
    count = sum(map(len, symbols.values()))
    texts = b"".join(one.encode() + b"\0" for some in symbols.values() for one in some)
    size = 4 + 4 * count + len(texts)
    place, places, body = 8 + 60 + size + size % 2, [], b""
    for name, code in members.items():
        places += [place + len(body)] * len(symbols[name])
        body += _member(f"{name}/", code)
    return (
        b"!<arch>\n" + _member("/", struct.pack(f">{count + 1}I", count, *places) + texts) + body
    )


def _member(name: str, content: bytes) -> bytes:
    head = f"{name:<16}{0:<12}{0:<6}{0:<6}{644:<8}{len(content):<10}`\n"
    return head.encode() + content + b"\n" * (len(content) % 2)
