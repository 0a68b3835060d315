"""What the parameters of all nodes have in common; those of a controller stand beside it."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Parameters(BaseModel):
    """Parameters of a node, under ros2_control's names."""

    model_config = ConfigDict(extra="allow", frozen=True)

    def claims(self) -> tuple[str, ...]:
        """The command interfaces that the controller claims while it is active, such as ``joint1/position``."""
        return ()

    def unused(self) -> list[str]:
        """What has no effect. Unknown ones may be upstream's: they are named in the log, not refused."""
        return sorted(self.model_extra or {})


class ManagerParameters(Parameters):
    """Of the controller manager itself."""

    update_rate: int = Field(100, gt=0, le=1000)  # upstream's default
