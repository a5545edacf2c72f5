"""Results as one page, one JSON and figures; the only place that imports matplotlib."""

from obsdesign.report import figures as figures
