"""Messages of recordings of ROS 2: built, written as CDR, read back, named by their type hash."""

from copy import copy
from functools import cache
from typing import Any, Self, final

from wideberth.framework.plugins.registry import unknown
from wideberth.framework.values.errors import WideberthError, nearest, short

from .definitions import DEFINITIONS
from .ros_extra import needed

DISTRIBUTIONS = ("humble", "jazzy", "kilted", "lyrical")
"""Of ROS 2, oldest first."""
MOST_BYTES = 2**26
"""Of one message; a longer one is refused."""

_RULE = "=" * 80 + "\n"
"""Line between the parts of a definition."""


@final
class Messages:
    """The message types of one distribution of ROS 2, and those of `DEFINITIONS`.

    Parameters
    ----------
    distribution : one of `DISTRIBUTIONS`.

    Raises
    ------
    WideberthError : another distribution, or the extra ``ros`` is not installed.

    Examples
    --------
    >>> known = Messages("jazzy")                                   # doctest: +SKIP
    >>> point = known.make("geometry_msgs/msg/Point", x=1.0)        # doctest: +SKIP
    >>> known.read("geometry_msgs/msg/Point", known.to_bytes(point)).x  # doctest: +SKIP
    1.0
    """

    def __init__(self, distribution: str = "jazzy") -> None:
        if distribution not in DISTRIBUTIONS:
            raise WideberthError(
                unknown("distribution of ROS 2", distribution, list(DISTRIBUTIONS))
            )
        types = needed("rosbags.typesys")
        self.distribution: str = distribution
        self.store: Any = types.get_typestore(types.Stores[f"ROS2_{distribution.upper()}"])
        self.add(DEFINITIONS)

    @classmethod
    def of_text(cls, name: str, text: str) -> Self:
        """Return the types that the text of one definition holds, as a recording stores it.

        Parameters
        ----------
        name : of the type.
        text : of its .msg file, with those that it holds behind it; or as IDL.

        Raises
        ------
        WideberthError : text that is no definition.
        """
        types = needed("rosbags.typesys")
        found: dict[str, Any] = {}
        try:
            if text.startswith(_RULE + "IDL: "):
                for part in text.split(_RULE)[1:]:
                    found |= types.get_types_from_idl(part.partition("\n")[2])
            else:
                found = types.get_types_from_msg(text, name)
            made = cls.__new__(cls)
            made.distribution = ""
            made.store = types.get_typestore(types.Stores.EMPTY)
            made.store.register(found)
            made.type_hash(name)
        except Exception as error:  # of a strange text: it fails in any way
            reason = short(str(error), 80)
            raise WideberthError(f"its definition of {name} cannot be read: {reason}") from None
        return made

    def add(self, definitions: dict[str, str]) -> None:
        """Learn types from the text of their definitions, name -> text of a .msg file.

        Raises
        ------
        WideberthError : text that is no definition, or another one of a type that is known.
        """
        types = needed("rosbags.typesys")
        found: dict[str, Any] = {}
        for name, text in definitions.items():
            try:
                found |= types.get_types_from_msg(text, name)
            except types.TypesysError as error:
                raise WideberthError(f"{name}: this is no definition ({error})") from None
        for name, (_, fields) in found.items():
            missing = _named(fields) - set(self.store.fielddefs) - set(found)
            if missing:
                raise WideberthError(f"{name} holds {min(missing)}, which is not defined")
        try:
            self.store.register(found)
        except types.TypesysError as error:
            raise WideberthError(f"{str(error).rstrip('.')}; give it another name") from None

    def __contains__(self, name: str) -> bool:
        """Whether there is a type of this name, as in ``"nav_msgs/msg/Path"``."""
        return name in self.store.fielddefs

    def make(self, name: str, /, **given: Any) -> Any:
        """Return a message; what is not given is zero, empty or False.

        Parameters
        ----------
        name : of its type, as in ``"nav_msgs/msg/Path"``.
        given : its fields.

        Raises
        ------
        WideberthError : no such type or field.
        """
        fields = dict(self.fields(name))
        for key in given:
            if key not in fields:
                raise WideberthError(unknown(f"field of {name}", key, list(fields)))
        values = {key: self._blank(kind) for key, kind in fields.items() if key not in given}
        return self.store.types[name](**values, **given)

    def to_bytes(self, message: Any) -> bytes:
        """Write a message as CDR (XCDR1, little-endian, with its header of four bytes).

        Raises
        ------
        WideberthError : a field has a value of another kind, or the message is too long.
        """
        name = message.__msgtype__
        try:
            data = bytes(self.store.serialize_cdr(message, name))
        except Exception as error:  # of a field: it fails in any way
            raise WideberthError(
                f"this {name} cannot be written ({type(error).__name__}: {error}); see that each "
                "field has a value of its kind"
            ) from None
        _check_size(name, data)
        return data

    def read(self, name: str, data: bytes) -> Any:
        """Return the message that CDR holds.

        Raises
        ------
        WideberthError : no such type, too many bytes, or bytes that are no such message.
        """
        self.fields(name)
        _check_size(name, data)
        try:
            return self.store.deserialize_cdr(data, name)
        except Exception as error:  # malformed bytes fail in any way
            reason = f"{type(error).__name__}: {short(str(error), 80)}"
            raise WideberthError(f"{len(data)} bytes are no {name} ({reason})") from None

    def prepare(self, name: str) -> None:
        """Generate the code that writes and reads a type, so that no message waits for it.

        Raises
        ------
        WideberthError : no such type.
        """
        self.read(name, self.to_bytes(self.make(name)))

    def type_hash(self, name: str) -> str:
        """Return the hash by which ROS 2 distinguishes definitions of one type (RIHS01).

        It is that of REP 2011: SHA-256 over the names and types of the fields, of the type itself
        and of all that it holds.

        Raises
        ------
        WideberthError : no such type.
        """
        self.fields(name)
        return str(self._hashing.hash_rihs01(name))

    @property
    def _hashing(self) -> Any:
        """The store with every char as the uint8 that it is in ROS 2; rosbags hashes another."""
        twin = copy(self.store)
        twin.fielddefs = {
            name: (constants, [(key, _without_char(kind)) for key, kind in fields])
            for name, (constants, fields) in self.store.fielddefs.items()
        }
        return twin

    def fields(self, name: str) -> list[tuple[str, Any]]:
        """Return the fields of a type: name, and kind as rosbags has it.

        Raises
        ------
        WideberthError : no such type.
        """
        if name not in self:
            near = nearest(name, self.store.fielddefs)
            raise WideberthError(f"there is no message {name!r}{near}")
        return list(self.store.fielddefs[name][1])

    def _blank(self, kind: Any) -> Any:
        """Return the value of a field that is not given."""
        import numpy as np

        what, inner = kind
        if what.name == "BASE":
            return {"string": "", "bool": False}.get(inner[0], 0)
        if what.name == "NAME":
            return self.make(inner)
        (element, base), length = inner
        count = length if what.name == "ARRAY" else 0
        if element.name == "BASE" and base[0] != "string":
            return np.zeros(count, _NUMBERS.get(base[0], base[0]))
        return [self._blank((element, base)) for _ in range(count)]


_NUMBERS = {"octet": "uint8", "byte": "uint8", "char": "uint8"}


def _without_char(kind: Any) -> Any:
    what, inner = kind
    if what.name == "BASE":
        return (what, ("uint8", inner[1])) if inner[0] == "char" else kind
    return kind if what.name == "NAME" else (what, (_without_char(inner[0]), inner[1]))


def _named(fields: list[tuple[str, Any]]) -> set[str]:
    """Return the types that fields hold."""
    found = set()
    for _, (what, inner) in fields:
        while what.name in ("ARRAY", "SEQUENCE"):
            what, inner = inner[0]
        if what.name == "NAME":
            found.add(inner)
    return found


def _check_size(name: str, data: bytes) -> None:
    if len(data) > MOST_BYTES:
        raise WideberthError(f"a {name} has {len(data)} bytes; wanted at most {MOST_BYTES}")


@cache
def messages(distribution: str = "jazzy") -> Messages:
    """Return the types of a distribution; made once."""
    return Messages(distribution)
