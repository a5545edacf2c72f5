"""The words that name formats of paths, without loading them."""

MISSION_WORDS = ("plan", "wpl")
PLACED_WORDS = (*MISSION_WORDS, "kml", "gpx", "geojson", "czml")  # that hold latitudes and longitudes
FORMAT_WORDS = (*PLACED_WORDS, "tum", "bag", "csv", "npz")
AUTOPILOTS = ("px4", "ardupilot")
