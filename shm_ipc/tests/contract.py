"""Writes or reads a record as CONTRACT.md describes it. Knows nothing of it but the table below a heading of that document.

    contract.py CONTRACT.md HEADING write    < lines "field value ..."    > bytes
    contract.py CONTRACT.md HEADING read     < bytes    > lines "field value ..."
"""
import re
import struct
import sys

CODES = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "f64": "d"}
ROW = r"^\| (\d+) \| (\d+) \| (\w+)(?:\[(\d+)\])? \| `(\w+)` \| .* \|$"


def fields(document, heading):
    """Offset, format and name of each field; each must begin where the table says, and be as long."""
    section = re.split(r"^##+ ", document, flags=re.MULTILINE)
    (text,) = [part for part in section if part.startswith(heading + "\n")]
    end = 0
    for offset, size, code, count, name in re.findall(ROW, text, re.MULTILINE):
        layout = f"<{count or 1}{CODES[code]}"
        assert struct.calcsize(layout) == int(size) and int(offset) >= end, name
        end = int(offset) + int(size)
        yield int(offset), layout, name


def main():
    path, heading, job = sys.argv[1:]
    with open(path, encoding="utf-8") as document:
        table = list(fields(document.read(), heading))
    assert table, f"no table of fields below {heading}"
    if job == "read":
        record = sys.stdin.buffer.read()
        for offset, layout, name in table:
            print(name, *map(repr, struct.unpack_from(layout, record, offset)))
        return
    last, layout, _ = table[-1]
    record = bytearray(last + struct.calcsize(layout))
    given = dict(line.split(" ", 1) for line in sys.stdin.read().splitlines())
    for offset, layout, name in table:
        number = float if layout.endswith("d") else int
        struct.pack_into(layout, record, offset, *map(number, given.pop(name).split()))
    assert not given, f"not in the table: {given}"
    sys.stdout.buffer.write(record)


main()
