"""Proposed maps: what is above 0.9 is right, column, unit and sign, on logs that they were not made with."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.maps.guess import ACCEPTED, Guess, guess, map_text
from lacet.daq.maps.words import meanings
from lacet.daq.sources.open_source import opened
from lacet.daq.sources.source import Reading
from lacet.daq.units import read_unit
from lacet.services.commands.__main__ import main
from tests.services.commands.test_json import conforms
from tests.support.foreign_logs import foreign, write_csv
from tests.support.naming import JUDGED, MADE_WITH, Truth, named_log
from tests.support.places import HOME
from tests.support.tables import piece

CAN = HOME / "tests" / "data" / "can"


def right(one: Guess, truth: Truth) -> bool:
    """Whether column, sign and unit of a proposal are those of the name."""
    sign = -1 if one.expression.startswith("-") else 1
    factor = read_unit(one.said_unit or one.unit).factor
    return (one.column, sign) == (truth.column, truth.sign) and factor == pytest.approx(truth.factor)


def counted(schemes: dict[str, tuple[str, dict[str, str]]], runs: tuple[str, ...], seeds: int) -> tuple[int, int, int]:
    """Of many drawn logs: names, proposals above the bar, and how many of these are right."""
    names = likely = good = 0
    for scheme in schemes.values():
        for run in runs:
            for seed in range(seeds):
                source, truth = named_log(piece(run, 3.0, 28.0), scheme, seed)
                for one in guess(source):
                    names += 1
                    if one.probability >= ACCEPTED:
                        likely += 1
                        good += right(one, truth[one.name])
    return names, likely, good


def test_above_the_bar_at_least_95_percent_are_right_on_names_and_runs_not_seen_before() -> None:
    """Three naming schemes, signs turned, units drawn or missing, two runs that nothing was set on."""
    names, likely, good = counted(JUDGED, ("sweep", "liftoff"), 2)
    assert likely >= 0.15 * names
    assert good >= 0.95 * likely


def test_so_it_is_for_those_it_was_made_with() -> None:
    names, likely, good = counted(MADE_WITH, ("sine",), 1)
    assert likely >= 0.4 * names
    assert good >= 0.95 * likely


def test_a_sign_that_is_turned_is_found_by_the_car_s_behaviour() -> None:
    """All columns with the vocabulary's sign or all against it: the same proposals, with a minus."""
    source, truth = named_log(piece("sine", 3.0, 28.0), MADE_WITH["short English"], 0)
    found = {one.name: one for one in guess(source) if one.probability >= ACCEPTED}
    turned = [name for name in found if truth[name].sign < 0]
    assert len(turned) >= 3
    assert all(found[name].expression.startswith("-") for name in turned)


def test_without_a_turn_no_lateral_sign_is_sure() -> None:
    source, _ = named_log(piece("liftoff", 3.0, 28.0), MADE_WITH["short English"], 1)
    lateral = [one for one in guess(source) if one.column in ("imu.accel.y", "imu.rate.z", "imu.attitude.roll")]
    assert lateral
    assert all(one.probability < ACCEPTED for one in lateral)


def test_a_real_car_s_bus_is_listed_and_proposed() -> None:
    """Speeds, throttle and engine for sure; the sign of a turn only where wheel speeds show one."""
    with opened(CAN / "road-car.candump.log", Reading(dbc=(CAN / "road-car.dbc",))) as source:
        found = {one.name: one for one in guess(source)}
    assert len(found) == 20
    assert found["ID_D1.SPEED"].column == "car.speed"
    assert found["ID_D1.SPEED"].probability >= ACCEPTED
    assert found["ID_D0.GYRO_YAW"].column == "imu.rate.z"
    assert found["ID_D0.STEER_ANGLE"].column == "steering.angle"
    assert found["ID_D4.WS_FL"].expression == "ID_D4.WS_FL / 0.31 m"
    assert found["ID_D4.WS_FL"].probability < ACCEPTED  # the radius is not known
    assert found["ID_140.RPM"].rate == pytest.approx(100.0, rel=0.05)
    assert found["ID_360.BOOST"].column == ""


def test_two_names_that_claim_a_column_alike_are_not_sure(tmp_path: Path) -> None:
    t = np.arange(0.0, 10.0, 0.01)
    table = np.column_stack([t, 20 + np.sin(t), 20 + np.cos(t)])
    np.savetxt(tmp_path / "a.csv", table, "%.6f", ",", header="t,Speed [m/s],VehSpd [m/s]", comments="")
    with opened(tmp_path / "a.csv") as source:
        found = guess(source)
    assert max(one.probability for one in found) < ACCEPTED


def test_the_map_written_is_read_and_what_is_not_sure_is_a_comment(tmp_path: Path) -> None:
    t, columns, _ = foreign(piece("sine", 5.0, 25.0))
    write_csv(tmp_path / "drive.csv", t, columns)
    result = tmp_path / "r.json"
    words = ["map", "--guess", tmp_path / "drive.csv", "-o", tmp_path / "map.toml", "--json", result]
    assert main(list(map(str, words))) == 0
    found = conforms(result, "map")
    sure = {one["column"] for one in found["names"] if one["probability"] >= ACCEPTED}
    assert len(ChannelMap.load(tmp_path / "map.toml").channels) == len(sure)
    text = (tmp_path / "map.toml").read_text(encoding="utf-8")
    assert sum(line.startswith('# "') for line in text.splitlines()) > 0
    assert main([*map(str, words), "--accept", "--force"]) == 0
    proposed = {one["column"] for one in found["names"] if one["column"]}
    assert len(ChannelMap.load(tmp_path / "map.toml").channels) == len(proposed)
    assert main(list(map(str, words))) == 2  # nothing is replaced


def test_one_component_alone_goes_to_its_own_channel() -> None:
    one = Guess("ay", "m/s²", 100.0, -1.0, 1.0, "imu.accel.y", "ay", "", 0.95)
    assert '"car.lateral_accel" = "ay"' in map_text([one], "a.csv")


def test_components_of_a_channel_keep_its_name_where_the_others_are_only_comments() -> None:
    """So that removing the # of the third component is all that a channel of three needs."""
    parts = [
        Guess(f"a{axis}", "m/s²", 100.0, -1.0, 1.0, f"imu.accel.{axis}", f"a{axis}", "", p)
        for axis, p in (("x", 0.8), ("y", 0.95), ("z", 0.95))
    ]
    text = map_text(parts, "a.csv")
    assert "car." not in text
    assert '\n"imu.accel.y" = "ay"' in text
    assert '\n# "imu.accel.x" = "ax"' in text


def test_what_a_log_does_not_say_is_in_the_map_to_be_filled_in() -> None:
    text = map_text([Guess("v", "m/s", 100.0, 0.0, 1.0, "car.speed", "v", "", 0.95)], "a.csv")
    bare = ChannelMap.parse(text, "map.toml")
    filled = ChannelMap.parse(re.sub(r"^# (\[run\]|\w+ = )", r"\1", text, flags=re.MULTILINE), "map.toml")
    assert bare.metadata == {}
    assert filled.metadata == {
        "vehicle": "vehicle.toml", "rig": "rig.toml", "wheel_reference": "hub", "brakes": "off"
    }  # fmt: skip


def test_the_unit_decides_between_a_velocity_and_a_rate(tmp_path: Path) -> None:
    t = np.arange(0.0, 10.0, 0.01)
    table = np.column_stack([t, 90 + np.sin(t), 10 * np.cos(t)])
    header = "t,Optical_VelLong [km/h],Unit_VelX [deg/s]"
    np.savetxt(tmp_path / "a.csv", table, "%.6f", ",", header=header, comments="")
    with opened(tmp_path / "a.csv") as source:
        assert [one.column for one in guess(source)] == ["correvit.speed.x", "imu.rate.x"]


@pytest.mark.parametrize(("name", "column"), [
    ("IMU_Heading", "imu.attitude.yaw"), ("GPS_Heading", "gnss.course"),
    ("Querbeschleunigung", "imu.accel.y"), ("LongAcc", "imu.accel.x"), ("YawRate", "imu.rate.z"),
    ("Vitesse_Lacet", "imu.rate.z"), ("Lenkradwinkel", "steering.angle"), ("WhlSpd_FL", "wheel.fl.speed"),
    ("Federweg_HR", "suspension.rr.travel"), ("Fz_VL", "wheel.fl.force.z"), ("GPS_Speed", "gnss.speed"),
    ("Bremsdruck", "brake.pressure"), ("Motordrehzahl", "engine.speed"), ("Wheel.RearLeft.ForceX", "wheel.rl.force.x"),
    ("Laser_Nabe_HL", "laser.rl.hub"), ("Hoehe_Boden_VR", "laser.fr.ground"), ("Lenkwinkel_VL", "camera.fl.steer"),
    ("Opt_Vlong", "correvit.speed.x"), ("BrkPress", "brake.pressure"), ("HLaser_LF", "laser.fl.ground"),
    ("v_laengs", "correvit.speed.x"), ("v_quer", "correvit.speed.y"), ("Lenkwinkel", "steering.angle"),
])  # fmt: skip
def test_the_usual_words_of_several_languages(name: str, column: str) -> None:
    assert meanings(name)[0].column == column


def test_a_proposal_that_is_a_comment_has_its_unit_in_the_map_too(tmp_path: Path) -> None:
    t = np.arange(0.0, 10.0, 0.01)
    columns = np.column_stack([t, 66 + np.sin(t), 66 + np.cos(t)])
    np.savetxt(tmp_path / "a.csv", columns, "%.6f", ",", header="t,Speed_kmh,VehSpd_kmh", comments="")
    with opened(tmp_path / "a.csv") as source:
        found = guess(source)
    assert max(one.probability for one in found) < ACCEPTED
    text = map_text(found, "a.csv").replace('# "car.speed"', '"car.speed"', 1)
    name = next(one.name for one in found if one.column)
    assert f'"{name}" = "km/h"' in text
    assert ChannelMap.parse(text).channels


def test_a_word_that_is_none_means_nothing() -> None:
    assert meanings("FuelLevel") == []
    assert meanings("gnss_speed.SpeedAccuracy")[0].words < 0.5


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("V", "car.speed"), ("Fahrgeschwindigkeit", "car.speed"), ("speedgps", "gnss.speed"),
        ("Vertikalbeschleunigung", "imu.accel.z"), ("imuax", "imu.accel.x"), ("G Force Lat", "imu.accel.y"),
        ("wheelspeedfl", "wheel.fl.speed"), ("WhlFL", "wheel.fl.speed"), ("Aufstandskraft VL", "wheel.fl.force.z"),
        ("DämpferwegHR", "damper.rr.travel"), ("Shock Pos LR", "damper.rl.travel"),
        ("Radbeschl_VL_z", "hub.fl.accel.z"), ("phi", "imu.attitude.roll"), ("phi_FL", "wheel.fl.angle"),
        ("PsiPunkt", "imu.rate.z"), ("Lenkradmoment", "steering.torque"), ("Débattement AVG", "suspension.fl.travel"),
    ],
)  # fmt: skip
def test_words_of_a_name_are_found_also_where_they_are_written_as_one(name: str, column: str) -> None:
    assert meanings(name)[0].column == column


@pytest.mark.parametrize(("name", "column"), [
    ("Fahrbahnabstand_VL", "laser.fl.ground"), ("Raddrehwinkel_HR", "wheel.rr.angle"),
    ("Antriebsmoment_VL", "shaft.fl.torque"), ("Bremsmoment_HL", "brake.rl.torque"),
    ("HalfShaftTorque_FR", "shaft.fr.torque"),
    ("Vit_Roulis", "imu.rate.x"), ("Vit_Lacet", "imu.rate.z"), ("VitRoue_AVG", "wheel.fl.speed"),
    ("Hauteur_ARD", "laser.rr.ground"), ("HauteurMoyeu_ARD", "laser.rr.hub"), ("IMU.AngularVelocity.X", "imu.rate.x"),
    ("左前輪_前後力", "wheel.fl.force.x"), ("右後輪_横力", "wheel.rr.force.y"), ("左後輪荷重", "wheel.rl.force.z"),
    ("右前輪_モーメントZ", "wheel.fr.moment.z"), ("左前輪_回転速度", "wheel.fl.speed"), ("左前車高", "laser.fl.ground"),
    ("右前輪_ストローク", "suspension.fr.travel"), ("左前輪ダンパストローク", "damper.fl.travel"),
    ("左前輪_舵角", "camera.fl.steer"), ("キャンバ角_右前", "camera.fr.camber"), ("前後加速度", "imu.accel.x"),
    ("横加速度", "imu.accel.y"), ("上下加速度", "imu.accel.z"), ("ヨーレート", "imu.rate.z"), ("ﾛｰﾙﾚｰﾄ", "imu.rate.x"),
    ("ピッチ角速度", "imu.rate.y"), ("ロール角", "imu.attitude.roll"), ("ピッチ", "imu.attitude.pitch"),
    ("車速", "car.speed"), ("横速度", "correvit.speed.y"), ("操舵角", "steering.angle"),
    ("ハンドル角", "steering.angle"),
    ("操舵トルク", "steering.torque"), ("ブレーキ液圧", "brake.pressure"), ("エンジン回転数", "engine.speed"),
    ("左前輪制動トルク", "brake.fl.torque"), ("アクセル開度", "engine.throttle"),
])  # fmt: skip
def test_german_french_and_japanese_words(name: str, column: str) -> None:
    assert meanings(name)[0].column == column


@pytest.mark.parametrize(
    "name", ["横滑り角", "舵角", "出力", "電圧", "時刻", "燃料圧力", "エンジントルク", "Fahrbahnreibwert_VL"]
)
def test_other_words_of_them_mean_no_channel(name: str) -> None:
    assert meanings(name) == []


def test_a_wanted_speed_is_hardly_the_car_s() -> None:
    assert meanings("目標車速")[0].words < 0.5


@pytest.mark.parametrize(
    ("unit", "column"), [("deg/s", "imu.rate.x"), ("deg", "imu.attitude.roll"), ("", "imu.attitude.roll")]
)
def test_the_unit_decides_between_an_angle_and_its_rate(tmp_path: Path, unit: str, column: str) -> None:
    t = np.arange(0.0, 10.0, 0.01)
    table = np.column_stack([t, 3.0 * np.sin(t)])
    np.savetxt(tmp_path / "a.csv", table, "%.6f", ",", header=f"t,Roulis [{unit}]", comments="")
    with opened(tmp_path / "a.csv") as source:
        assert [one.column for one in guess(source)] == [column]


def test_a_map_that_says_only_how_to_read_is_enough_to_guess_and_goes_into_the_map_proposed(tmp_path: Path) -> None:
    t = np.arange(0.0, 10.0, 0.01)
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, 5 + t]), "%.3f", ",", header="秒,車速[km/h]", comments="",
               encoding="euc_jp")  # fmt: skip
    read = tmp_path / "read.toml"
    read.write_text('format = "lacet-map 1"\n[read]\nencoding = "euc_jp"\ntime = "秒"\n', encoding="utf-8")
    out = tmp_path / "map.toml"
    assert main(["map", "--guess", str(tmp_path / "a.csv"), "--read", str(read), "-o", str(out)]) == 0
    proposed = ChannelMap.load(out)
    assert (proposed.reading.encoding, proposed.reading.time, list(proposed.channels)) == (
        "euc_jp",
        "秒",
        ["car.speed"],
    )
    read.write_text('format = "lacet-map 1"\n[read]\nencodng = "euc_jp"\n', encoding="utf-8")
    assert main(["map", "--guess", str(tmp_path / "a.csv"), "--read", str(read)]) == 2


@pytest.mark.parametrize("name", ["time", "lapdist", "relay", "gear", "clutch", "Battery Voltage", "tirepressure_fl"])
def test_a_name_of_other_words_means_no_channel(name: str) -> None:
    assert meanings(name) == []


@pytest.mark.parametrize(("unit", "column"), [("g", "imu.accel.y"), ("deg/s", "imu.rate.y")])
def test_the_unit_decides_between_an_acceleration_and_a_rate(tmp_path: Path, unit: str, column: str) -> None:
    t = np.arange(0.0, 10.0, 0.01)
    table = np.column_stack([t, 0.5 * np.sin(t)])
    np.savetxt(tmp_path / "a.csv", table, "%.6f", ",", header=f"t,Gy [{unit}]", comments="")
    with opened(tmp_path / "a.csv") as source:
        assert [one.column for one in guess(source)] == [column]


def test_a_unit_that_no_meaning_of_the_name_can_have_leaves_it_without_a_proposal(tmp_path: Path) -> None:
    t = np.arange(0.0, 10.0, 0.01)
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, 20.0 + t]), "%.6f", ",", header="t,Speed [kg]", comments="")
    with opened(tmp_path / "a.csv") as source:
        assert [one.column for one in guess(source)] == [""]


@pytest.mark.parametrize(("name", "column", "unit"), [
    ("Lenkwinkel_HL_deg", "camera.rl.steer", "deg"), ("Geschw_quer_kmph", "correvit.speed.y", "km/h"),
    ("yaw_rate_deg_s", "imu.rate.z", "deg/s"), ("Fz_FL_N", "wheel.fl.force.z", "N"),
    ("Accel Y [g]", "imu.accel.y", "g"), ("Drehzahl.VL.1pmin", "wheel.fl.speed", "1/min"),
    ("GyroZ_degs", "imu.rate.z", "deg/s"), ("VitRoue_AVG_trmin", "wheel.fl.speed", "1/min"),
    ("Raddrehzahl_VL_mm", "wheel.fl.speed", "rad/s"),
    ("Raddrehzahl_VR_Rad", "wheel.fr.speed", "rad/s"), ("My_FR_n", "wheel.fr.moment.y", "kN·m"),
])  # fmt: skip
def test_a_name_may_end_in_its_unit(tmp_path: Path, name: str, column: str, unit: str) -> None:
    """Also where the values would fit another better; a wheel at the end and a small letter are no unit."""
    t = np.arange(0.0, 10.0, 0.01)
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, 0.3 * np.sin(t)]), "%.6f", ",", header=f"t,{name}", comments="")
    with opened(tmp_path / "a.csv") as source:
        (one,) = guess(source)
    assert (one.column, one.said_unit or one.unit) == (column, unit)


def drive_with_pots(folder: Path) -> tuple[Path, Path]:
    """Two logs of one drive: loads and readings of potentiometers that shorten in compression; an inertial unit."""
    run = piece("rough", 3.0, 28.0)
    t = run.signals["wheel.fl.force"].t
    columns = {"t [s]": t}
    for corner in ("fl", "fr", "rl", "rr"):
        hub = run.signals[f"laser.{corner}.hub"]
        travel = -(hub.values[:, 0] - np.mean(hub.values[:, 0]))
        columns[f"Pot_{corner.upper()} [mm]"] = 150.0 - 1e3 * np.interp(t, hub.t, travel)
        if corner[0] == "f":
            columns[f"WFT_{corner.upper()}_Fz [N]"] = run.signals[f"wheel.{corner}.force"].values[:, 2]
    columns["Brake_P [bar]"] = 5.0 + np.sin(t)
    columns["WFT_FL_Rot [1/min]"] = np.full(len(t), 400.0) + np.sin(t)
    unit = run.signals["imu.attitude"]
    rates = run.signals["imu.rate"]
    own = {"t [s]": unit.t, "Time2 [s]": unit.t}
    own |= {f"INS_{name} [deg]": np.rad2deg(unit.values[:, k]) for k, name in enumerate(("Roll", "Pitch", "Heading"))}
    own |= {f"INS_Gyro{a} [deg/s]": np.rad2deg(np.interp(unit.t, rates.t, rates.values[:, k]))
            for k, a in enumerate("XYZ")}  # fmt: skip
    for name, table in (("main", columns), ("ins", own)):
        head = ",".join(table)
        np.savetxt(folder / f"{name}.csv", np.column_stack(list(table.values())), "%.9g", ",", header=head, comments="")
    return folder / "main.csv", folder / "ins.csv"


def test_the_logs_of_one_drive_are_judged_together(tmp_path: Path) -> None:
    """As ``lacet import`` takes them: names that both have are told apart by their file."""
    main_log, unit = drive_with_pots(tmp_path)
    result = tmp_path / "r.json"
    words = ["map", "--guess", main_log, unit, "--accept", "-o", tmp_path / "map.toml", "--json", result]
    assert main(list(map(str, words))) == 0
    found = conforms(result, "map")
    assert found["files"] == [str(main_log), str(unit)]
    columns = {one["column"]: one for one in found["names"] if one["column"]}
    assert columns["imu.attitude.yaw"]["name"] == "INS_Heading"  # beside a roll and a pitch angle of its name
    assert "gnss.course" not in columns
    assert columns["brake.pressure"]["name"] == "Brake_P"
    assert columns["wheel.fl.speed"]["name"] == "WFT_FL_Rot"
    text = (tmp_path / "map.toml").read_text(encoding="utf-8")
    assert "proposed from main.csv, ins.csv" in text
    made = ChannelMap.load(tmp_path / "map.toml").channels
    assert {"imu.attitude.roll", "imu.attitude.yaw", "wheel.fl.speed", "damper.rr.travel"} <= made.keys()


def test_potentiometers_of_one_kind_have_one_sign_and_count_from_the_middle(tmp_path: Path) -> None:
    """Also those at the wheels without a load; what reads 150 mm at rest is no travel from design height."""
    main_log, unit = drive_with_pots(tmp_path)
    with opened(main_log) as first, opened(unit) as second:
        found = {one.name: one for one in guess(first, second)}
    for corner in ("FL", "FR", "RL", "RR"):
        one = found[f"Pot_{corner}"]
        assert one.column == f"damper.{corner.lower()}.travel"
        zero, minus, name = one.expression.partition(" mm - ")
        assert (minus, name, one.own_zero) == (" mm - ", f"Pot_{corner}", True)
        assert float(zero) == pytest.approx(150.0, abs=5.0)
    text = map_text(list(found.values()), "main.csv", accept=True)
    assert text.count("counted from this log's median: better from the reading at design height") == 4


def test_a_course_alone_is_no_attitude() -> None:
    assert [meaning.column for meaning in meanings("GPS_Heading")] == ["gnss.course"]
