"""What can go wrong."""

from typing import Literal

Kind = Literal[
    "camera_name",
    "setting",
    "shared_memory_full",
    "not_mapped",
    "already_publishing",
    "incompatible",
    "other_version",
    "too_many_consumers",
    "too_many_held",
    "mask_pending",
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
    """Frames or health cannot be had: what is wrong, where, and what mends it."""

    kind: Kind
    """For programs: texts may change, the word stays."""
    message: str
    """What is wrong, and where."""
    remedy: str | None
    """What mends it; None where that is not known."""

    def __init__(self, kind: Kind, message: str, remedy: str | None = None) -> None:
        super().__init__(kind, message, remedy)
        self.kind, self.message, self.remedy = kind, message, remedy

    def __str__(self) -> str:
        return f"{self.message}: {self.remedy}" if self.remedy else self.message
