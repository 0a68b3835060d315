"""A file of servo models for tests."""

from collections.abc import Iterator
from contextlib import contextmanager

from drivers.servos import catalog

GOOD = """\
sts3046:
  like: sts3215
  number: 1545
  rated_voltage_v: 7.4
  supply_v: [4.4, 8.9]
  stall_torque_nm: 3.92
  no_load_speed_rad_s: 4.76
my-xm540:
  like: xm430-w350
  number: 1129
  stall_torque_nm: 10.6
  registers:
    external_port_mode_1: {address: 56, size: 1, eeprom: true, values: [0, 3]}
    external_port_data_1: {address: 152, size: 2}
scs20:
  like: scs15
  number: 1300
  sensor_deg: 200.0
"""


@contextmanager
def forgotten() -> Iterator[None]:
    """After the block, remove all user-defined models from the catalog."""
    try:
        yield
    finally:
        for name, model in list(catalog._ADDED.items()):
            del catalog.series_of(model).by_name[name], catalog.MODELS[name]
            del catalog._ADDED[name], catalog._FILES[name]
