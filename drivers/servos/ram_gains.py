"""Factory values of the gains that Dynamixel servos keep in RAM, where any program can change them.

Source: ROBOTIS e-manual, control tables on the models' pages.
"""

from collections.abc import Mapping
from typing import Final

from drivers.servos import ax_mx, x, xl320
from drivers.servos.register import Register, ServoModel

_X_PID: Final = {
    x.XL330_M077.name: (400, 400, 0),
    x.XL330_M288.name: (400, 0, 0),
    x.XC330_M181.name: (1200, 0, 500),
    x.XC330_M288.name: (1100, 0, 500),
    x.XC330_T181.name: (900, 0, 0),
    x.XC330_T288.name: (900, 0, 0),
    x.XL430_W250.name: (640, 0, 4000),
    x.XC430_W150.name: (460, 0, 0),
    x.XC430_W240.name: (700, 0, 0),
    x.XM430_W210.name: (800, 0, 0),
    x.XM430_W350.name: (800, 0, 0),
    x.XH430_W210.name: (900, 0, 0),
    x.XH430_W350.name: (900, 0, 0),
    x.XH430_V210.name: (800, 0, 0),
    x.XH430_V350.name: (800, 0, 0),
    x.XD430_T210.name: (900, 0, 0),
    x.XD430_T350.name: (900, 0, 0),
    x.XM540_W150.name: (800, 0, 0),
    x.XM540_W270.name: (800, 0, 0),
    x.XH540_W150.name: (800, 0, 0),
    x.XH540_W270.name: (800, 0, 0),
    x.XH540_V150.name: (800, 0, 0),
    x.XH540_V270.name: (800, 0, 0),
    x.XD540_T150.name: (800, 0, 0),
    x.XD540_T270.name: (800, 0, 0),
    x.XW540_T140.name: (800, 0, 0),
    x.XW540_T260.name: (800, 0, 0),
    x.XW540_H260.name: (800, 0, 0),
    x.XW430_T333.name: (900, 0, 0),
    x.TWO_XL430_W250.name: (640, 0, 4000),
    x.TWO_XC430_W250.name: (700, 0, 0),
    x.MX_28_2.name: (850, 0, 0),
    x.MX_64_2.name: (850, 0, 0),
    x.MX_106_2.name: (850, 0, 0),
}
"""Position P, I and D gains of the X-series models that have a table in the e-manual."""
_FEED_FORWARD: Final = {x.feedforward_2nd_gain: 0, x.feedforward_1st_gain: 0}
_MX: Final = {ax_mx.p_gain: 32, ax_mx.i_gain: 0, ax_mx.d_gain: 0}
_AX: Final = {
    ax_mx.cw_compliance_margin: 1,
    ax_mx.ccw_compliance_margin: 1,
    ax_mx.cw_compliance_slope: 32,
    ax_mx.ccw_compliance_slope: 32,
}
_OTHER: Final[dict[str, Mapping[Register, int]]] = {
    ax_mx.MX_12W.name: {ax_mx.p_gain: 8, ax_mx.i_gain: 0, ax_mx.d_gain: 8},
    ax_mx.AX_12W.name: {
        ax_mx.cw_compliance_margin: 4, ax_mx.ccw_compliance_margin: 4,
        ax_mx.cw_compliance_slope: 64, ax_mx.ccw_compliance_slope: 64,
    },
}  # fmt: skip
"""Gains of the protocol 1.0 models that differ from the others, keyed by model name."""
_XL320: Final = {xl320.p_gain: 32, xl320.i_gain: 0, xl320.d_gain: 0}


def ram_gains(model: ServoModel) -> Mapping[Register, int]:
    """Return the factory values of the position loop gains that a servo keeps in RAM.

    Args:
        model: Model of the servo.

    Returns:
        Factory values, keyed by register. The result is empty for Feetech servos, whose gains are in EEPROM. Gains
        whose factory value is unknown are missing.
    """
    if isinstance(model, x.XModel):
        registers = (x.position_p_gain, x.position_i_gain, x.position_d_gain)
        return dict(zip(registers, _X_PID.get(model.name, ()), strict=False)) | _FEED_FORWARD
    if isinstance(model, ax_mx.AxMxModel):
        return _OTHER.get(model.name) or (_MX if ax_mx.p_gain in model.own else _AX)
    return _XL320 if model == xl320.XL320 else {}
