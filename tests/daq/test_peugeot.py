"""The shipped rig and vehicle of the Peugeot 406 load, fit each other, the drivers and the model."""

from __future__ import annotations

from lacet.daq.channels import CHANNELS, STANDARD
from lacet.daq.rig import DEFAULT_TOLERANCE, Rig
from lacet.daq.vehicle import Vehicle
from lacet.drivers import open_driver
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.properties.whole_vehicle import NAMES, UNITS

RIG = Rig.load("peugeot-406")
VEHICLE = Vehicle.load("peugeot-406")


def test_every_channel_of_the_papers_instruments_is_measured_by_a_driver():
    delivered = {}
    for sensor in RIG.sensors:
        assert sensor.driver is not None
        assert sensor.bus is not None
        driver = open_driver(sensor.driver, sensor.bus, sensor.options, RIG.folder)
        assert set(driver.channels) == set(sensor.channels)
        delivered |= dict.fromkeys(sensor.channels, sensor.name)
    assert set(delivered) == set(STANDARD)


def test_each_driver_is_on_a_bus_of_its_kind():
    kinds = {sensor.driver: RIG.buses[str(sensor.bus)].kind for sensor in RIG.sensors}
    assert kinds == {"igel": "can", "lasers": "can", "correvit": "can", "sagem": "serial", "zimmer": "udp"}


def test_the_sensor_sheet_is_whole():
    for sensor in RIG.sensors:
        families = {CHANNELS[channel].family for channel in sensor.channels}
        assert set(sensor.noise) == families
        instruments = {family.split(".")[0] for family in families}
        sheet = {key for key in DEFAULT_TOLERANCE if key.rsplit(".", 1)[0] in families | instruments} | {"latency"}
        assert set(sensor.tolerance) == sheet


def test_every_a_priori_value_belongs_to_a_parameter_or_a_whole_vehicle_value_of_its_unit():
    known = dict(zip(NAMES, UNITS, strict=True))
    for effect in catalogue(VEHICLE, RIG.wheel_reference).values():
        known |= {parameter.name: parameter.unit for parameter in effect.parameters}
    assert {key: q.unit for key, q in VEHICLE.apriori.items()} == {key: known.get(key) for key in VEHICLE.apriori}


def test_every_number_has_a_source():
    assert all(len(quantity.source) > 10 for quantity in [*VEHICLE.numbers.values(), *VEHICLE.apriori.values()])
