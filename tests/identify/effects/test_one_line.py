"""One-line effects: what is read is what NumPy computes, nothing is run, and lines that are no law are refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from lacet.daq.channels import CORNERS
from lacet.daq.dimension import FORCE, LENGTH, MASS, NUMBER, TIME, Dimension
from lacet.daq.errors import UsageError
from lacet.daq.expressions.written_units import whole_unit
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import BODY_ROWS
from lacet.identify.effects.catalogue import effect_classes
from lacet.identify.effects.language.compiled import WHEEL_FORCE, OneLine, effect_class
from lacet.identify.effects.language.parser import LineFault, read_line, read_lines
from lacet.identify.effects.language.states import STATES, all_names, use_of
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
VEHICLE = cars.with_tables(VEHICLE)


@pytest.fixture(scope="module")
def motion() -> Motion:
    """Single instants of a lively drive."""
    return build_motion(cars.recording(cars.random_signals(3), VEHICLE, cars.in_reference(RIG, "hub")))


def variants(text: str) -> dict[str, OneLine]:
    """The effects of a line by key."""
    return {e.key: e for e in effect_class(read_line(text)).variants(VEHICLE, "hub")}


def refused(text: str) -> LineFault:
    """The fault of a line."""
    with pytest.raises(LineFault) as caught:
        effect_class(read_line(text))
    return caught.value


# ---- laws that the catalogue has too


@pytest.mark.parametrize(("text", "same"), [
    ("x = suspension: k * (travel - travel_other)", "anti_roll_bar"),
    ("x = suspension: f * tanh(rate/v0), v0 = 2 5 10 20 40 mm/s", "coulomb"),
    ("x = suspension: min(travel, gap) * k, gap = -0.04 -0.02 -0.01 0 0.01 0.02 0.04 m", "helper_spring"),
    ("x = suspension: d * sign(rate) * max(0, abs(rate) - v0), v0 = 50 70 100 150 250 mm/s", "damper_knee"),
    ("x = suspension: p * abs(travel) * rate", "damper_stroke_symmetric"),
    ("x = suspension: f * hysteresis(travel, length), length = 1 3 10 mm", "damper_hysteresis"),
    ("x = suspension: c * (lag(rate, T) - rate), T = 5 20 80 300 ms, c in 0..10000 N·s/m", "damper_mount"),
    ("x = suspension: k * 10 mm*(max(0, travel - gap)/10 mm)**n, gap = 5 10 15 20 30 40 60 mm, n = 1 2", "bump_stop"),
    ("x = chassis.fx: d*speed*abs(speed); chassis.my: m*vx*abs(vx)", "aero_drag"),
])  # fmt: skip
def test_a_line_is_the_catalogues_effect(text: str, same: str, motion: Motion) -> None:
    """Variants, shapes, units and columns are those of the class that has the same law, to the last digit."""
    mine = list(variants(text).values())
    theirs = effect_classes()[same].variants(VEHICLE, "hub")
    assert [e.where for e in mine] == [e.where for e in theirs]
    for one, other in zip(mine, theirs, strict=True):
        assert [p.unit for p in one.parameters] == [p.unit for p in other.parameters]
        for shaped, known in zip(one.shapes(), other.shapes(), strict=True):
            assert dict(shaped.shape) == pytest.approx(dict(known.shape), rel=1e-14)
            found, wanted = shaped.columns(motion), replace(known, shape=shaped.shape).columns(motion)
            assert found.keys() == wanted.keys()
            for row, table in wanted.items():
                assert np.array_equal(found[row], table), row


# ---- random expressions against NumPy


@st.composite
def numbers(draw: st.DrawFn, depth: int = 3) -> tuple[str, str]:
    """A dimensionless expression as a line has it, and as NumPy has it."""
    if depth == 0 or draw(st.booleans()):
        name = draw(
            st.sampled_from(["steer", "camber_other", "side", "steer_rl", "0.7", "2", "3e-1", "(rate/0.5 m/s)"])
        )
        return name, name.replace(" m/s", "")
    a, b = draw(numbers(depth - 1)), draw(numbers(depth - 1))
    one = draw(
        st.sampled_from(["({} + {})", "({} - {})", "{} * {}", "({} / (2 + abs({})))", "max({}, {})", "min({}, {})"])
    )
    out = one.format(a[0], b[0]), one.format(a[1], b[1])
    function = draw(st.sampled_from(["", "", "abs", "tanh", "sin", "cos", "atan", "exp", "sign", "-"]))
    power = draw(st.sampled_from(["", "", "**2", "^3"]))
    return tuple(f"{function}({text}){power}" for text in out)  # type: ignore[return-value]


@settings(max_examples=60, deadline=None)
@given(numbers())
def test_a_law_is_what_numpy_computes(motion: Motion, law: tuple[str, str]) -> None:
    """Each random law, times a state, is the same number as Python with NumPy gives for it."""
    mine, theirs = law
    assume(len(mine) < 800)
    try:
        effect = variants(f"x = suspension.front: p * ({mine}) * travel")["x.front"]
    except LineFault as fault:
        assume("no plausible size" not in fault.says and "nested" not in fault.says and "more than" not in fault.says)
        raise
    for corner, other in (("fl", "fr"), ("fr", "fl")):
        part = motion.corners[corner]
        names = {
            "steer": part.steer, "camber_other": motion.corners[other].camber, "side": 1.0 if corner == "fl" else -1.0,
            "steer_rl": motion.corners["rl"].steer, "rate": part.rate,
            "max": np.maximum, "min": np.minimum, "abs": np.abs, "tanh": np.tanh, "sin": np.sin, "cos": np.cos,
            "atan": np.arctan, "exp": np.exp, "sign": np.sign,
        }  # fmt: skip
        with np.errstate(all="ignore"):
            wanted = eval(theirs.replace("^", "**"), {"__builtins__": {}}, names) * part.travel
        if not np.all(np.isfinite(wanted)):
            with pytest.raises(UsageError, match="no finite value"):
                effect.columns(motion)
            return
        np.testing.assert_allclose(effect.columns(motion)[f"suspension.{corner}"][0], wanted, rtol=1e-12, atol=1e-300)


@settings(max_examples=200, deadline=None)
@given(st.text(alphabet="pk travelrate_othersuspension:;,=*/+-^()[]{}.0123456789 mN²·°#'\"\\\n\t\x00é", max_size=80))
def test_any_text_is_a_line_or_a_usage_error(text: str) -> None:
    """Whatever is typed, nothing but UsageError is raised, and its mark stands within the line."""
    for line in (text, f"suspension: p * {text}", f"x = suspension: p*travel, {text}"):
        fault: UsageError | None = None
        try:
            effect_class(read_line(line))
        except UsageError as caught:
            fault = caught
        if isinstance(fault, LineFault):
            assert 0 <= fault.start <= fault.stop <= len(line) + 1


@pytest.mark.parametrize("law", [
    "__import__('os').system('touch run') * p", "p * open('x')", "p * travel.__class__", "p * [x for x in (1,)]",
    "p * (lambda: 1)", "p * (1 if travel else 2)", "p * travel[0]", "p * f'{travel}'", "p * eval('1')", "p * 'a'",
    "p * (x := 2)", "p * True", "p * 1j", "p * travel if p else 1", "p * not travel", "p * (travel < 1)", "p * ~travel",
    "p * travel // 2", "p @ travel", "p * {1}", "p * ...", "p * abs(*travel)", "p * abs(x=travel)", "p * abs()",
    "p * 9**9**9", "p * 2**travel", "p * travel**99", "p * travel**(1/0)", "p * travel**(2 m)",
    "p * " + "(" * 300 + "1" + ")" * 300,
    "p * " + "-" * 900 + "travel", "p * " + "travel + " * 100 + "travel", "p * travel * 0x10", "p * 1_000 * travel",
    "p * 10**400 * travel", "", "p *", "p * travel) * (rate", "p; travel", "p * travel \\", "p * travél",
])  # fmt: skip
def test_what_is_no_law_is_refused(law: str, tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names of Python, attributes, comprehensions, lambdas, comparisons, huge powers and deep nests: refused unrun."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError):
        effect_class(read_line(f"x = suspension: {law}"))
    assert not list(tmp_path.iterdir())


# ---- linear in the parameters, on the tree


@pytest.mark.parametrize(("text", "says", "marked"), [
    ("suspension: tanh(v * rate)", "v stands inside tanh", "tanh(v * rate)"),
    ("suspension: p**2 * travel", "p is raised to a power", "p**2"),
    ("suspension: p * p * travel", "p appears squared", "p * p"),
    ("suspension: p * (1 + q) * travel", "p and q are multiplied", "p * (1 + q)"),
    ("suspension: travel / p", "p stands in a divisor", "p"),
    ("suspension: k * 2**n", "n stands in an exponent", "2**n"),
    ("suspension: k * travel**n, n = 1 2", "an exponent must be a number, or a constant where", "n"),
    ("suspension: k * lag(rate, 30 mm)", "the second argument of lag() is in s, and this is in m", "30"),
    ("suspension: k * hysteresis(travel, 3)", "the second argument of hysteresis() is in m", "3"),
    ("suspension: k * lag(rate, t)", "the second argument of lag() is a constant", "t"),
    ("suspension: k * travel*lag(2, 1 s)", "lag() follows a measured state, and there is none", "2"),
    ("suspension: k * lag(rate)", "lag takes 2 argument(s)", "lag(rate)"),
    ("suspension: k * tanh(k * steer)", "k stands inside tanh", "tanh(k * steer)"),
    ("suspension: p * travel + rate", "this has no parameter", "rate"),
    ("suspension: travel", "there is no parameter", "travel"),
    ("suspension: p * travell", "did you mean 'travel'", "travell"),
    ("suspension: p * rate_fx", "after rate may stand _other", "rate_fx"),
    ("chassis.fx: p * travel", "write travel_fl", "travel"),
    ("suspensoin: p * travel", "did you mean 'suspension'", "suspensoin"),
    ("suspension.middle: p * travel", "there is no row", "suspension.middle"),
    ("p * travel", "where does it act", "p * travel"),
    ("Bump = suspension: p * travel", "small letters", "Bump"),
    ("tyre = suspension: p * travel", "another name", "tyre"),
    ("suspension: p * travel, v0 = 1 m/s", "v0 is not in the law", "v0 = 1 m/s"),
    ("suspension: p * travel, q in 0..1 N", "q is no parameter", "q in 0..1 N"),
    ("suspension: p * travel, p in 0..1 N", "p is in N/m by its law", "p in 0..1 N"),
    ("suspension: p * travel, p in 1..0 N/m", "below the upper", "p in 1..0 N/m"),
    ("suspension: p * travel / a, a = 1 m, rate = 1 m", "rate has a meaning", "rate"),
    ("suspension: p * travel / a, a = 1 blorp", "'blorp' is no unit", "blorp"),
    ("suspension: p * travel * 2 blorp", "'blorp' is no unit", "blorp"),
    ("suspension: p · travel", "write *", "·"),
    ("suspension: p * sinh(steer)", "sinh is not known", "sinh"),
    ("suspension: p * max(travel)", "max takes 2", "max(travel)"),
    # units
    ("suspension: p * (travel + rate)", r"travel [m] and rate [m/s] have different units", "travel + rate"),
    ("suspension: p*travel^2 + p*tanh(rate)", "tanh() takes a plain number, and rate is in m/s", "rate"),
    ("suspension: p * max(travel, 0.01 s)", "different units", "max(travel, 0.01 s)"),
    ("suspension: p * travel**(1 m)", "has no unit", "1"),
    ("chassis.fx: d*speed^2; chassis.my: d*speed^2", "d is in N·s²/m² by the row before, and would be in N·s²/m here",
     "d*speed^2"),
])  # fmt: skip
def test_a_line_that_is_no_law_is_marked_where_it_is_wrong(text: str, says: str, marked: str) -> None:
    """The message says what, and the mark stands under it."""
    fault = refused(text)
    assert says in fault.says
    assert fault.text[fault.start : fault.stop].strip() == marked.strip()
    line, mark = str(fault).splitlines()[-2:]
    assert line[mark.index("^") :].startswith(marked.split(" m)")[0][:3].strip())


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-3, 3), min_size=2, max_size=2), st.integers(0, 3))
def test_the_parts_add_up_to_the_law(motion: Motion, theta: list[float], which: int) -> None:
    """Columns × values is the law with the values written into it, whatever brackets the parameters stood in."""
    p, q = theta
    law = ["(p + q*rate)*travel/(1 + abs(rate))", "-(p - q*rate)*travel*2", "travel*((p)*0.5 + rate*q - p)",
           "(p*travel - q*travel*rate)/cos(steer)"][which]  # fmt: skip
    effect = variants(f"x = suspension.fl: {law.replace('rate', '(rate/1 m/s)')}")["x.fl"]
    assert [n.name for n in effect.parameters] == ["x.fl.p", "x.fl.q"]
    part = motion.corners["fl"]
    names = {"p": p, "q": q, "travel": part.travel, "rate": part.rate, "steer": part.steer, "abs": abs, "cos": np.cos}
    wanted = eval(law, {"__builtins__": {}}, names)
    found = effect.force(motion, np.array(theta))["suspension.fl"]
    np.testing.assert_allclose(found, wanted, atol=1e-12)


# ---- units


@pytest.mark.parametrize(("text", "unit"), [
    ("suspension: p * travel**2 * sign(rate)", "N/m²"), ("suspension: p * rate", "N·s/m"), ("tyre: p * accel", "kg"),
    ("suspension: p * sqrt(abs(rate))", "N·s^(1/2)/m^(1/2)"), ("suspension: p * load", "-"), ("spin: p * mz", "-"),
    ("chassis.my: p * speed**2", "N·s²/m"), ("chassis.mz: p * yaw_accel", "kg·m²"), ("suspension: p*fy**2", "1/N"),
    ("suspension: p * max(0, travel - 20 mm) / 1 cm", "N"), ("spin.fl: p * spin", "N·m·s"),
    ("suspension: p*steer", "N"),
    ("chassis.fy: p * fy_fl/(speed_x*t), speed_x = 3 km/h", "m"), ("suspension: p/t/travel", "N·m·s"),
])  # fmt: skip
def test_a_parameters_unit_follows_from_its_law(text: str, unit: str) -> None:
    """Row unit ÷ unit of what it multiplies, and the printed unit reads back as the same dimension."""
    text = text.replace("speed_x", "v0")
    effect = next(iter(variants(f"x = {text}").values()))
    assert [p.unit for p in effect.parameters] == [unit]
    if "^(" not in unit:
        assert whole_unit(unit) == (1.0, next(iter(effect.line.parameters.values())))


@given(st.integers(-3, 3), st.integers(-3, 3), st.integers(-3, 3))
def test_units_read_back(mass: int, length: int, time: int) -> None:
    """Every dimension's unit is read as that dimension, except where a power is above 4."""
    found = Dimension.of(mass, length, time)
    powers = (mass, length - mass, time + 2 * mass)
    if max(map(abs, powers)) <= 4:
        assert whole_unit(found.unit) == (1.0, found)


@pytest.mark.parametrize(("text", "size", "dimension"), [
    ("mm/s", 1e-3, LENGTH / TIME), ("km/h", 1 / 3.6, LENGTH / TIME), ("N s/m", 1.0, FORCE * TIME / LENGTH),
    ("N*s/m", 1.0, FORCE * TIME / LENGTH), ("kN/mm", 1e6, FORCE / LENGTH), ("deg", math.pi / 180, NUMBER),
    ("m^2", 1.0, LENGTH**2), ("cm²", 1e-4, LENGTH**2), ("", 1.0, NUMBER), ("-", 1.0, NUMBER), ("1/s", 1.0, TIME**-1),
    ("N/(m·s)", 1.0, FORCE / LENGTH / TIME), ("kg", 1.0, MASS),
])  # fmt: skip
def test_units_as_they_are_written(text: str, size: float, dimension: Dimension) -> None:
    """Factor and dimension of units in their usual spellings."""
    factor, found = whole_unit(text)
    assert (factor, found) == (pytest.approx(size, rel=1e-14), dimension)


def test_a_number_takes_the_unit_behind_it_and_no_more(motion: Motion) -> None:
    """`2 m/speed` is 2 m divided by speed; `20 mm` is 0.02 m also behind a power sign."""
    one = variants("x = suspension.fl: p * travel^2/20 mm * (2 m/speed)/(0.1 s)")["x.fl"]
    part, speed = motion.corners["fl"], motion.velocity[0]  # type: ignore[index]
    np.testing.assert_allclose(one.columns(motion)["suspension.fl"][0], part.travel**2 / 0.02 * 2 / speed / 0.1)
    assert one.parameters[0].unit == "N/m"


# ---- places, bounds, states


@pytest.mark.parametrize(("text", "wheres"), [
    ("x = suspension: p*travel^2", ["front", "rear", *CORNERS]),
    ("x = suspension.front: p*travel^2", ["front"]),
    ("x = tyre.all: p*deflection^2", ["all"]),
    ("x = suspension: p*rate_other", ["front", "rear"]),
    ("x = chassis.fx: p*speed^2", [""]),
    ("x = suspension.fl: p*travel_rr; suspension.rr: -p*travel_fl", [""]),
    ("x = spin: p*spin; chassis.my: -p*spin_fl", ["front", "rear", *CORNERS]),
])  # fmt: skip
def test_the_variants_are_the_places_left_open(text: str, wheres: list[str], motion: Motion) -> None:
    """A row with a place stays there, one without goes to both axles and each corner."""
    found = variants(text)
    assert list(found) == [f"x.{w}" if w else "x" for w in wheres]
    for effect in found.values():
        assert set(effect.columns(motion)) == {row for row, _, _ in effect.acted_on()}
        assert effect.lacks(motion) == ()


def test_bounds_are_those_given_or_keep_the_force_plausible(motion: Motion) -> None:
    """Given bounds are taken as they are; others keep the law within a wheel's load at usual states."""
    given_ = variants("x = suspension.fl: k*travel, k in 0..20 N/mm")["x.fl"].parameters[0]
    assert (given_.low, given_.high, given_.expect) == (0.0, pytest.approx(2e4), "positive")
    for law, usual in (("p*travel", 0.04), ("p*rate", 0.3), ("p*travel^3", 0.04**3), ("p*sign(rate)", 1.0)):
        p = variants(f"x = suspension.fl: {law}")["x.fl"].parameters[0]
        assert p.low == -p.high
        assert p.high * usual == pytest.approx(WHEEL_FORCE, rel=0.1), law
    stop = variants("x = suspension.fl: k*max(0, travel - gap), gap = 20 60 mm")["x.fl"].parameters[0]
    assert stop.high * 0.02 == pytest.approx(WHEEL_FORCE, rel=0.1)
    assert "Give bounds" in refused("x = suspension: k*max(0, travel - 9 m)").says
    assert variants("x = suspension: k*max(0, travel - 9 m), k in 0..1 N/m")


def test_every_state_has_a_unit_that_is_its_dimension(motion: Motion) -> None:
    """Each state can be written, is finite, shaped (N,), and its printed unit is its dimension."""
    for name in all_names():
        use = use_of(name)
        assert use is not None
        if use.wheel != "other":
            value = use.value(motion, "fl" if use.wheel == "own" else "")
            assert np.broadcast_shapes(np.shape(value), (motion.t.size,)) == (motion.t.size,)
            assert np.all(np.isfinite(value)), name
    for state in STATES.values():
        assert whole_unit(state.unit) == (1.0, state.dimension), state.name
        assert state.low < state.high
        assert (state.wheel is None) != (state.body is None)


def test_a_state_that_is_not_measured_is_named(motion: Motion) -> None:
    """The other wheel's laser, the speed sensor: asked for where the law needs them, and only there."""
    bar = variants("x = suspension: k*(travel - travel_other)*(speed/1 m/s)")["x.front"]
    less = replace(motion, channels=motion.channels - {"laser.fr.hub", "correvit.speed"}, velocity=None)
    assert set(bar.lacks(less)) == {"laser.fr.hub", "correvit.speed"}
    assert bar.lacks(motion) == ()
    rear = variants("x = suspension: k*travel^2")["x.rear"]
    assert rear.lacks(less) == ()
    combined = replace(less, rows=BODY_ROWS)
    assert set(bar.lacks(combined)) == {"laser.fr.hub", "correvit.speed"}, "the body's rows are sums of suspensions'"
    assert rear.lacks(combined) == ()


def test_a_load_is_there_where_the_angles_of_its_wheel_follow_from_others() -> None:
    """From steering and travels: their errors turn a load in the second order. A load that is derived is none."""
    motion = build_motion(cars.recording(cars.random_signals(4), VEHICLE, RIG))
    (law,) = effect_class(read_line("pull = suspension.fl: p * travel * fx")).variants(VEHICLE, "hub")
    cameras = {name for name in motion.channels if name.startswith("camera.")}
    without = replace(motion, channels=motion.channels - cameras)
    assert set(law.lacks(without)) == {"camera.fl.steer", "camera.fl.camber"}
    assert law.lacks(replace(without, derived=frozenset(cameras))) == ()
    nominal = replace(motion, channels=motion.channels - {"wheel.fl.force"}, derived=frozenset({"wheel.fl.force"}))
    assert law.lacks(nominal) == ("wheel.fl.force",)


def test_a_law_without_a_finite_value_names_time_and_state(motion: Motion) -> None:
    """Where, when and at which values of the states."""
    effect = variants("x = suspension.fl: p * log(travel/1 m)")["x.fl"]
    first = int(np.flatnonzero(motion.corners["fl"].travel <= 0)[0])
    with pytest.raises(UsageError) as caught:
        effect.columns(motion)
    assert f"t = {motion.t[first]:.2f} s of exact, where travel = {motion.corners['fl'].travel[first]:.4g} m" in str(
        caught.value
    )


def test_a_files_lines_are_read_or_named() -> None:
    """Comments and empty lines are passed over; a fault has file and line number."""
    text = "# mine\n\na = suspension: p*travel^2  # what it is\nb = tyre.all: p*deflection^3\n"
    assert [(line.name, line.about) for line in read_lines(text, "f")] == [("a", "what it is"), ("b", "")]
    with pytest.raises(UsageError, match="f, line 5: there is another effect 'a'"):
        read_lines(text + "a = suspension: p*rate^3", "f")
    with pytest.raises(UsageError, match="f, line 5: this effect has no name"):
        read_lines(text + "suspension: p*rate^3", "f")
    with pytest.raises(UsageError, match=r"f, line 5: .*\n.*\n +\^"):
        read_lines(text + "c = suspension: p*rat", "f")


# ---- memory


def test_laws_with_memory_are_what_their_equations_integrate_to() -> None:
    """lag() follows T ẏ + y = x, hysteresis() Dahl's equation; both along the run, and so no law of an instant."""
    record = cars.recording(cars.random_signals(3), VEHICLE, cars.in_reference(RIG, "hub"))
    still = build_motion(record)
    t = np.arange(2000) / 250.0
    travel = 0.02 * np.sin(5.0 * t) + 0.01 * np.sin(31.0 * t)
    corner = replace(still.corners["fl"], travel=travel)
    moving = replace(still, t=t, corners={**still.corners, "fl": corner})
    effect = variants("x = suspension.fl: k * lag(travel, 40 ms) + f * hysteresis(travel, 3 mm)")["x.fl"]
    assert not effect.instantaneous
    assert variants("x = suspension.fl: k * travel")["x.fl"].instantaneous
    found = effect.columns(moving)["suspension.fl"]

    def rates(time: float, state: list[float]) -> list[float]:
        s = 0.02 * math.sin(5.0 * time) + 0.01 * math.sin(31.0 * time)
        v = 0.1 * math.cos(5.0 * time) + 0.31 * math.cos(31.0 * time)
        return [(s - state[0]) / 0.04, (v - abs(v) * state[1]) / 0.003]

    exact = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.01).y
    assert np.max(np.abs(found[0] - exact[0])) < 1e-3 * np.max(np.abs(exact[0]))
    # Where the travel turns round between two samples, a part of the stroke is not seen.
    assert np.max(np.abs(found[1] - exact[1])) < 0.02


def test_a_constant_above_zero_is_asked_for_by_memory(motion: Motion) -> None:
    for law in ("lag(travel, T), T = 0 s", "hysteresis(travel, length), length = -1 mm"):
        with pytest.raises(UsageError, match="no finite value"):
            variants(f"x = suspension.fl: k * {law}")["x.fl"].columns(motion)
