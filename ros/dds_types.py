"""Message types as Cyclone DDS has them, made from the definitions of ROS 2."""

from functools import cache
from typing import Any

from .messages import Messages
from .ros_extra import needed

_OTHER = {"string": str, "bool": bool}
_NUMBERS = {"octet": "uint8", "byte": "uint8", "char": "uint8"}


@cache
def idl_class(known: Messages, name: str) -> Any:
    """Return the class of a message for Cyclone DDS, under the name that ROS 2 has on the wire.

    ``nav_msgs/msg/Odometry`` is ``nav_msgs::msg::dds_::Odometry_`` there.

    Parameters
    ----------
    known : the types. name : of the message.

    Raises
    ------
    WideberthError : no such type, or the extra ``ros`` is not installed.
    """
    idl, types = needed("cyclonedds.idl"), needed("cyclonedds.idl.types")

    def converted(kind: Any) -> Any:
        what, inner = kind
        if what.name == "BASE":
            base, bound = str(inner[0]), inner[1]
            if base == "string" and bound:
                return types.bounded_str[bound]
            return _OTHER.get(base) or getattr(types, _NUMBERS.get(base, base))
        if what.name == "NAME":
            return idl_class(known, inner)
        element, length = inner
        if what.name == "ARRAY":
            return types.array[converted(element), length]
        return types.sequence[(converted(element), length) if length else converted(element)]

    package, folder, last = name.split("/")
    fields = {field: converted(kind) for field, kind in known.fields(name)}
    fields = fields or {"structure_needs_at_least_one_member": types.uint8}
    return idl.make_idl_struct(f"{last}_", f"{package}.{folder}.dds_.{last}_", fields)
