"""A client that sets parameters has an answer for each of them, and nobody a traceback."""

from typing import Any

import pytest

pytest.importorskip("rclpy")

from rcl_interfaces.msg import Parameter, ParameterValue, SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically

from nodes.set_parameters import answering

GOOD = Parameter(name="good", value=ParameterValue(type=3, double_value=1.0))
STRANGE = Parameter(name="strange", value=ParameterValue(type=77))
FAILING = Parameter(name="failing", value=ParameterValue(type=3))
WHY = "parameter 'strange' cannot be set because its type 77 does not exist: use 0 to 9"


def setting(request: Any, response: Any) -> Any:
    """As rclpy does it: one result for each, or one for all."""
    if any(parameter.name == "failing" for parameter in request.parameters):
        raise ZeroDivisionError("a plug-in's")
    result = SetParametersResult(successful=True)
    if isinstance(response, SetParameters.Response):
        response.results = [result] * len(request.parameters)
    else:
        response.result = result
    return response


def test_of_several_the_good_ones_are_set(caplog: pytest.LogCaptureFixture) -> None:
    request = SetParameters.Request(parameters=[STRANGE, GOOD, FAILING, GOOD])
    results = answering(SetParameters, setting)(request, SetParameters.Response()).results
    assert [result.successful for result in results] == [False, True, False, True]
    assert results[0].reason == WHY and "a plug-in's" in results[2].reason
    assert "Traceback" not in caplog.text


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ([GOOD], ""),
        ([], ""),
        ([GOOD, STRANGE], WHY),
        ([FAILING], "parameter 'failing' cannot be set: a plug-in's"),
    ],
)
def test_together_they_are_set_or_none_is(parameters: list[Parameter], reason: str) -> None:
    request = SetParametersAtomically.Request(parameters=parameters)
    result = answering(SetParametersAtomically, setting)(request, SetParametersAtomically.Response()).result
    assert (result.successful, result.reason) == (not reason, reason)


def test_other_services_stay_as_they_are() -> None:
    assert answering(GetParameters, setting) is setting
