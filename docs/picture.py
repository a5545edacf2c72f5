"""Take the first picture of the committed example's report for the README. Run by `make examples`."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
page = (ROOT / "reports" / "examples" / "aerosonde_wind" / "report.html").read_text(encoding="utf-8")
picture = re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL)[0]
if "xmlns=" not in picture:
    picture = picture.replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"', 1)
(ROOT / "docs" / "aerosonde_wind.svg").write_text(picture + "\n", encoding="utf-8")
