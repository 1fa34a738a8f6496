"""Tables of where the rows come from, and why derived values are not determined."""

from typing import Any

from lacet.services.render.identifiability import not_derived_lines
from lacet.services.render.row_sources import sources_table, sources_tables


def source(row: str, kind: str, **more: Any) -> dict[str, Any]:
    """A row source as plain data."""
    empty: dict[str, Any] = {"derived": {}, "assumed": {}, "assumptions": [], "moves": 0.0, "size": 0.0, "add": ""}
    return {"row": row, "unit": "N", "source": kind, "runs": ["a"], **empty, **more}


def test_rows_channels_and_assumptions_have_a_table_each():
    """The workbench gets what is printed: rows with what to add, what channels are taken from, what is assumed."""
    radius = {
        "name": "loaded_radius.front", "value": 0.29, "tolerance": 0.01, "unit": "m", "given": False,
        "source": "drawing", "moves": 12.0,
    }  # fmt: skip
    result = [
        source(
            "chassis.fx", "assumed", derived={"wheel.fl.speed": "speed ÷ loaded radius"}, assumptions=[radius],
            moves=12.0, size=300.0, assumed={"wheel.fl.moment": "forces in the contact patch"},
        ),
        source("tyre.fl", "impossible", add="needs: laser.fl.ground"),
        source("tyre.fr", "impossible", add="needs: laser.fr.ground"),
    ]  # fmt: skip
    rows, channels, assumed = sources_tables(result)
    assert rows["lines"][0][:4] == [
        "chassis.fx", "assumed", "wheel.speed, wheel.moment", "12 of 300 N: loaded_radius.front",
    ]  # fmt: skip
    assert rows["lines"][1][4] == "needs: laser.{c}.ground"
    assert [table["note"][:3] for table in (rows, channels, assumed)] == ["{c}", "", ""]
    assert channels["lines"] == [
        ["wheel.fl.speed", "derived", "speed ÷ loaded radius"],
        ["wheel.fl.moment", "assumed", "forces in the contact patch"],
    ]
    assert assumed["lines"] == [["loaded_radius.front", "0.29", "0.010", "m", "default: drawing"]]
    alike = [{**radius, "name": f"camber.{c}"} for c in ("fl", "fr", "rl", "rr")]
    alike += [{**radius, "name": f"slip.{where}"} for where in ("front", "rear")]
    alike += [{**radius, "name": f"toe.{c}", "value": value} for c, value in (("fl", 0.0), ("fr", 0.1))]
    more = sources_tables([source("chassis.fx", "assumed", assumptions=alike)])[-1]["lines"]
    assert [line[0] for line in more] == ["camber.*", "slip.front, rear", "toe.fl", "toe.fr"]
    assert all(len(line) == len(table["head"]) for table in (rows, channels, assumed) for line in table["lines"])
    assert [len(sources_tables(result[1:])), len(sources_tables([]))] == [1, 0]
    assert "  tyre.fl, fr: needs: laser.{c}.ground\n  {c}: the row's own corner" in sources_table(result)
    assert "tyre.fl: needs: laser.fl.ground" in sources_table(result[1:2])


def test_wheel_loads_at_one_axle_alone_are_told_what_the_runs_without_them_have():
    """Only there: not where all corners are formed, nor where none is."""
    some = [source("suspension.fl", "measured"), source("suspension.rl", "impossible", add="needs: wheel.rl.force")]
    told = "without any wheel load: leave wheel.* out"
    assert told in " ".join(sources_table(some).split())
    assert told not in " ".join(sources_table(some[:1]).split())
    assert told not in " ".join(sources_table(some[1:]).split())


def value(name: str, why: str) -> dict[str, Any]:
    """A derived value as plain data, not determined where there is a reason."""
    return {"name": name, "identifiable": not why, "why": why}


def test_derived_values_of_one_reason_share_a_line():
    """A kind is named once where all its corners lack the same, each value where some are known."""
    result = {
        "row_sources": [],
        "derived": [
            value("ride_rate.fl", "suspension.fl needs: laser.fl.hub"),
            value("ride_rate.fr", "suspension.fr needs: laser.fr.hub"),
            value("hop_frequency.front", "suspension.fl needs: laser.fl.hub"),
            value("hop_frequency.rear", ""),
            value("pitch.frequency", "no such car"),
            value("roll.frequency", ""),
        ],
    }
    assert not_derived_lines(result) == [
        "  ride_rate, hop_frequency.front: suspension.{c} needs: laser.{c}.hub",
        "  pitch.frequency: no such car",
        "  {c}: the row's own corner; *: all four.",
    ]


def test_without_suspension_rows_it_is_said_why_no_value_is_derived():
    rows = [source(f"suspension.{c}", "impossible", add=f"needs: wheel.{c}.force") for c in ("fl", "fr")]
    lines = not_derived_lines({"row_sources": rows, "derived": []})
    assert lines[0] == "  all: suspension.{c} needs: wheel.{c}.force"
    both = {**value("anti_roll_bar.sum.k", ""), "value": 1.0}
    assert not_derived_lines({"row_sources": rows, "derived": [both]})[0].startswith("  all others: suspension.{c}")
