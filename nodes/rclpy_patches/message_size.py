"""Measure the size of a C message before it is converted to Python.

The conversion holds the GIL and does not release it while it converts a list of numbers. While a message with 200,000
trajectory points is converted, the control loop competes for the GIL for almost two seconds. The offsets of the fields
come from the introspection type support. The structures of the type support (message_introspection.h of Jazzy) are
defined in this module.
"""

import ctypes
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np

_INTROSPECTION: Final = b"rosidl_typesupport_introspection_c"
_STRING, _WIDE_STRING, _MESSAGE = 16, 17, 18  # These values and the sizes below are from field_types.h.
_SIZES: Final = {1: 4, 2: 8, 3: 16, 4: 1, 5: 2, 6: 1, 7: 1, 8: 1, 9: 1, 10: 2, 11: 2, 12: 4, 13: 4, 14: 8, 15: 8}
_NO_FIELD: Final = "structure_needs_at_least_one_member"
"""Name of the only C field in an empty message."""
_WORD: Final = ctypes.sizeof(ctypes.c_size_t)
_SEQUENCE: Final = 3 * _WORD
"""Size of a sequence or string header in bytes: data address, size and capacity."""


class _TypeSupport(ctypes.Structure):
    """First fields of rosidl_message_type_support_t."""

    _fields_ = (("identifier", ctypes.c_char_p), ("data", ctypes.c_void_p))


class _Member(ctypes.Structure):
    """C structure rosidl_typesupport_introspection_c__MessageMember."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("type_id", ctypes.c_uint8),
        ("string_upper_bound", ctypes.c_size_t),
        ("members", ctypes.c_void_p),
        ("is_key", ctypes.c_bool),
        ("is_array", ctypes.c_bool),
        ("array_size", ctypes.c_size_t),
        ("is_upper_bound", ctypes.c_bool),
        ("offset", ctypes.c_uint32),
        ("default_value", ctypes.c_void_p),
        ("functions", ctypes.c_void_p * 6),
    )


class _Members(ctypes.Structure):
    """First fields of rosidl_typesupport_introspection_c__MessageMembers, up to the member list."""

    _fields_ = (
        ("namespace", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("count", ctypes.c_uint32),
        ("size", ctypes.c_size_t),
        ("has_any_key_member", ctypes.c_bool),
        ("members", ctypes.POINTER(_Member)),
    )


@dataclass(frozen=True, slots=True)
class _Part:
    """A sequence or a string within a message."""

    offset: int
    size: int
    """Size of each element, in bytes."""
    within: "Layout | None" = None
    """Layout of each element if the elements contain sequences."""
    inline: int = 0
    """Number of elements of an array within the message, or 0 for a sequence."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of one message type."""

    names: tuple[str, ...]
    """Names of the fields."""
    size: int
    """Size without the contents of sequences and strings, in bytes."""
    parts: tuple[_Part, ...]

    def measured(self, address: int, allowed: int) -> int:
        """Return the size of the message at ``address`` in bytes, or any number above ``allowed`` if the message is
        larger than ``allowed``."""
        return self.size + self._contents(address, allowed - self.size)

    def _contents(self, address: int, allowed: int) -> int:
        total = 0
        for part in self.parts:
            data, count = address + part.offset, part.inline
            if not part.inline:
                data, count = _words(data, 2)
                total += count * part.size
            if count and part.within is not None and total <= allowed:
                total += part.within.of_all(data, count, allowed - total)
            if total > allowed:
                return total
        return total

    def of_all(self, data: int, count: int, allowed: int) -> int:
        """Return the total size of all sequences in an array of ``count`` messages at ``data``, in bytes."""
        if all(part.within is None and not part.inline for part in self.parts):
            table = np.array(_words(data, count * self.size // _WORD)).reshape(count, -1)
            return sum(int(table[:, part.offset // _WORD + 1].sum()) * part.size for part in self.parts)
        total = 0
        for place in range(count):
            total += self._contents(data + place * self.size, allowed - total)
            if total > allowed:
                break
        return total


_TEXT: Final = Layout((), _SEQUENCE, (_Part(0, 1),))
_WIDE_TEXT: Final = Layout((), _SEQUENCE, (_Part(0, 2),))


def _words(address: int, count: int) -> Any:
    return (ctypes.c_size_t * count).from_address(address)


@cache
def layout_of(kind: Any) -> Layout:
    """Return the layout of a message type. Exceptions from ctypes are passed to the caller.

    Raises:
        ValueError: The fields differ from the fields of the Python type.
    """
    kind.__class__.__import_type_support__()
    layout = _layout(_introspection(capsule_address(kind._TYPE_SUPPORT)))
    known = tuple(kind.get_fields_and_field_types())
    if layout.names != known:
        raise ValueError(f"{kind.__name__} has the fields {', '.join(layout.names)} instead of {', '.join(known)}")
    return layout


def capsule_address(capsule: object) -> int:
    """Return the address that an unnamed Python capsule contains."""
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    return int(get(capsule, None))


def _introspection(support: int) -> int:
    find = ctypes.CDLL("librosidl_runtime_c.so").get_message_typesupport_handle
    find.restype, find.argtypes = ctypes.c_void_p, (ctypes.c_void_p, ctypes.c_char_p)
    found = find(support, _INTROSPECTION)
    if not found:
        raise ValueError(f"a message type has no {_INTROSPECTION.decode()}")
    return int(found)


def _layout(support: int) -> Layout:
    data = _TypeSupport.from_address(support).data
    members = _Members.from_address(data)
    fields = [members.members[place] for place in range(members.count)]
    parts = tuple(part for member in fields for part in _parts(member))
    names = tuple(name for member in fields if (name := member.name.decode()) != _NO_FIELD)
    return Layout(names, members.size, parts)


def _parts(member: _Member) -> Iterator[_Part]:
    """Yield the sequences and strings of one field."""
    within = {_STRING: _TEXT, _WIDE_STRING: _WIDE_TEXT}.get(member.type_id)
    if member.type_id == _MESSAGE:
        within = _layout(_introspection(member.members))
    size = _SIZES[member.type_id] if within is None else within.size
    dynamic = within if within is not None and within.parts else None
    if member.is_array and (not member.array_size or member.is_upper_bound):
        yield _Part(member.offset, size, dynamic)
    elif dynamic is not None:
        yield _Part(member.offset, size, dynamic, inline=member.array_size or 1)
