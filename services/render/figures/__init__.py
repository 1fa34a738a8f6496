"""Pictures of values and plain data: charts written as SVG, other figures drawn with matplotlib."""

from lacet.daq.parts import require

require("plots")
