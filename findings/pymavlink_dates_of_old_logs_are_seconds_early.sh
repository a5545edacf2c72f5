#!/usr/bin/env bash
# pymavlink 2.4.50: DFReader turns the GPS week and milliseconds of a dataflash log into Unix time by taking off 18 s, the difference of
# GPS time and UTC since 2017, whatever the date is. Logs from before 2017 come out early: by 1 s after July 2015, 2 s after July 2012,
# 3 s after January 2009. What to do: take TimeUS of the messages, or add the leap seconds of the date.
# States: version, and for GPS messages of two instants, noon of 1 June 2014 (GPS - UTC = 16 s) and of 1 June 2020 (18 s), by how many
# seconds the time of the message is off.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "pymavlink==2.4.50"
cat > "$folder/dates.py" <<'PYTHON'
import struct, sys
from datetime import datetime, timezone
from importlib.metadata import version
from pymavlink import DFReader

GPS_EPOCH = datetime(1980, 1, 6, tzinfo=timezone.utc)

def format_message(kind, length, name, letters, columns):
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, length, name, letters, columns)

def error(year, leap_seconds, file):
    noon = datetime(year, 6, 1, 12, tzinfo=timezone.utc)
    week, seconds = divmod(int((noon - GPS_EPOCH).total_seconds()) + leap_seconds, 7 * 86400)
    log = format_message(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    log += format_message(130, 3 + 8 + 1 + 4 + 2, b"GPS", b"QBIH", b"TimeUS,Status,GMS,GWk")
    for k in range(3):
        log += b"\xa3\x95\x82" + struct.pack("<QBIH", 1_000_000 + 200_000 * k, 3, 1000 * seconds + 200 * k, week)
    with open(file, "wb") as out:
        out.write(log)
    reader = DFReader.DFReader_binary(file)
    message = reader.recv_match(type="GPS")
    return round(message._timestamp - noon.timestamp(), 3)

print("pymavlink", version("pymavlink"), "2014:", error(2014, 16, sys.argv[1]), "2020:", error(2020, 18, sys.argv[1]))
PYTHON
"$folder/venv/bin/python" "$folder/dates.py" "$folder/log.bin" | tee "$folder/seen"
diff "$folder/seen" - <<'SEEN'
pymavlink 2.4.50 2014: -2.0 2020: 0.0
SEEN
echo "as stated"
