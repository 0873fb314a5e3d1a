"""What can go wrong."""

from typing import Literal

Kind = Literal[
    "camera_name",
    "setting",
    "shared_memory_full",
    "not_mapped",
    "already_publishing",
    "incompatible",
    "too_many_consumers",
    "too_many_held",
    "permission",
    "foreign",
    "unwritable",
    "no_room",
    "too_few_files",
    "address_space",
    "header",
    "system",
    "closed",
    "in_use",
    "forked",
]
"""What kind of error it is."""


class Error(Exception):
    """Frames or health cannot be had. The text names what is wrong, where, and what mends it."""

    kind: Kind
    """For programs: the text may change, the word stays."""

    def __init__(self, kind: Kind, text: str) -> None:
        super().__init__(kind, text)
        self.kind = kind

    def __str__(self) -> str:
        return str(self.args[1])
