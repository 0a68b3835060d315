"""Page of ``servoloop view``: the arm in 3D, plots of one joint, and tables of the servos and the control loop."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import viser
import viser.uplot as uplot

from hal.hal_errors import DescriptionError
from hal.robot_description.description import Description, UrdfJoint, parse_urdf
from hal.text_file import read_xml
from hal.types import FloatArray
from servoloop.dashboard import tables
from servoloop.dashboard.arm_model import DrawnArm
from servoloop.dashboard.narrow_page import LAYOUT
from servoloop.dashboard.scene import CHOICES, PLAIN, DrawnScene, add_ground, place_camera, shares
from servoloop.dashboard.shapes import DrawnShape, arm_shapes, scene_shapes, shapes, thing_shapes
from servoloop.dashboard.tables import STRIPS, StateTable, Strip, TableCell, axis_range, strip_data
from servoloop.recording.history import KEPT_S
from servoloop.recording.robot_state import GoalPath, ObservedRobot, RobotSnapshot, health, servo_faults
from servoloop.stack.arm_folders import ArmFolder, arms, read_arm
from servoloop.stack.shipped_files import ARM_FILE

if TYPE_CHECKING:
    from nodes.planning_client.scene_watch import WatchedScene
    from servoloop.dashboard.planned import PlannedScene

HEIGHT_PX: Final = 150
COLORS: Final = ("#d2522d", "#4682dc")


class Strips:
    """Plots on the page."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._plots = [self._add(server, strip) for strip in STRIPS]

    def show(self, watched: ObservedRobot, place: int) -> None:
        """Plot the last minute for the joint with index ``place``."""
        minute = watched.minute()
        for strip, plot in zip(STRIPS, self._plots, strict=True):
            data = strip_data(minute, strip.columns, place)
            scales = _scales(axis_range(data[1:], strip.least))
            if scales != plot.scales:  # setting the scales recreates the plot
                plot.scales = scales
            plot.data = data

    def _add(self, server: viser.ViserServer, strip: Strip) -> viser.GuiUplotHandle:
        axes: Any = (uplot.Axis(size=30), uplot.Axis(size=52))
        return server.gui.add_uplot(
            strip_data(ObservedRobot().minute(), strip.columns, 0),
            (
                uplot.Series(label="s"),
                *(
                    uplot.Series(label=name, stroke=color, width=1.5)
                    for name, color in zip(strip.columns, COLORS, strict=False)
                ),
            ),
            title=strip.title,
            scales=_scales((0.0, strip.least)),
            axes=axes,
            legend=uplot.Legend(show=False),
            height=HEIGHT_PX,
        )


def _scales(range_y: tuple[float, float]) -> dict[str, uplot.Scale]:
    return {"x": uplot.Scale(time=False, range=(-KEPT_S, 0.0)), "y": uplot.Scale(range=range_y)}


STYLE: Final = 'style="width:100%;font-size:0.78em;border-collapse:collapse;text-align:left"'
ROW: Final = 'style="border-bottom:1px solid #8884"'
COLUMNS: Final = ("position", "error", "temp.", "supply", "state")
"""Columns of the joint table. The other quantities are shown in the plots."""


def servo_table(snapshot: RobotSnapshot, joints: Mapping[str, UrdfJoint]) -> str:
    """Return a table of the joints' positions, errors, temperatures, voltages and states, as HTML."""
    return html(tables.joint_table(snapshot, joints, COLUMNS))


def faults(snapshot: RobotSnapshot) -> str:
    """Return all errors and warnings as HTML, or an empty string if there are none."""
    rows = tables.fault_table(snapshot).rows
    return "".join(f"<p>{_cell(name)}: {_cell(message)}</p>" for name, message in rows)


def loop_table(snapshot: RobotSnapshot) -> str:
    """Return a table of loop timing and diagnostics, as HTML."""
    return html(tables.loop_table(snapshot))


def counter_table(snapshot: RobotSnapshot) -> str:
    """Return a table of the communication errors of each servo and port, as HTML."""
    return html(tables.counter_table(snapshot))


def controller_table(snapshot: RobotSnapshot) -> str:
    """Return tables of the components, the controllers with their latest goals, and the goal results, as HTML."""
    results = tables.result_table(snapshot)
    return html(tables.controller_table(snapshot)) + (html(results) if results.rows else "")


def html(table: StateTable) -> str:
    """Return a table as HTML, with escaped cell texts."""
    lines = [f"<th>{'</th><th>'.join(map(escape, table.head))}</th>"]
    lines += [f"<td>{'</td><td>'.join(map(_cell, row))}</td>" for row in table.rows]
    return f"<table {STYLE}><tr {ROW}>{f'</tr><tr {ROW}>'.join(lines)}</tr></table>"


def _cell(cell: TableCell) -> str:
    text = escape(cell.text)
    return f'<b style="color:#d2322d">{text}</b>' if cell.level else text


NO_JOINTS: Final = ("–",)
RED: Final = "#d2322d"
LOST_S: Final = 5
"""Maximum time without data before a page reports that its connection is lost, in seconds."""
_STATUS: Final = f"""<style>
@keyframes answered {{{{ to {{{{ visibility: hidden; position: absolute }}}} }}}}
@keyframes lost {{{{ to {{{{ visibility: visible; position: static }}}} }}}}
</style><p style='margin:0.5em 1em' data-beat='{{beat}}'>
<b style='color:{{color}};animation:answered 0s {LOST_S}s forwards'>{{text}}</b>
<b style='color:{RED};visibility:hidden;position:absolute;animation:lost 0s {LOST_S}s forwards'>
the connection to servoloop view is lost; the page is outdated</b></p>"""
"""Status line. Its animations run in the browser, so the text changes even if the program has ended."""


def known_arm(xml: str, folder: Path | None = None) -> ArmFolder | None:
    """Return the arm in ``folder``, or else the arm in config/arms with this robot description, or None.

    Raises ArmFileError if the arm's file is invalid.
    """
    if folder is not None and (folder / ARM_FILE).is_file():
        return read_arm(folder)
    return next((arm for arm in arms() if read_xml(arm.urdf, DescriptionError) == xml), None)


def _around(known: ArmFolder | None) -> tuple[Iterable[DrawnShape], Iterable[DrawnShape]]:
    """Return the shapes of the fixed and loose objects around an arm, or no shapes if the arm is unknown."""
    if known is None or not known.scene.is_file():
        return (), ()
    return scene_shapes(known.scene), thing_shapes(known.scene)


class Page:
    """Content of the page, which all browsers share."""

    def __init__(
        self,
        server: viser.ViserServer,
        folder: Path | None = None,
        planner: "Callable[[], tuple[WatchedScene, float]] | None" = None,
    ) -> None:
        """Create the page.

        Args:
            server: Server of the page.
            folder: Folder of the arm, or None to find the arm in config/arms by its robot description.
            planner: Function that returns the motion planner's latest scene and the time of a steady clock, in seconds;
                None if there is no planner.
        """
        self._server, self._folder, self._planner = server, folder, planner
        self._planned: PlannedScene | None = None
        self._arm: DrawnScene | None = None
        self._description: Description | None = None
        self._model: DrawnArm | None = None
        self._joints: tuple[str, ...] = ()
        self._xml = ""
        self._goal: GoalPath | None = None
        add_ground(server)
        gui = server.gui
        gui.add_html(LAYOUT)
        self._status = gui.add_html("")
        controls = gui.add_folder("Arm")
        self.above_arm = controls.order - 0.5
        """Order value for controls that are placed above the *Arm* folder."""
        with controls:
            self._colors = gui.add_dropdown("Color", CHOICES, initial_value=PLAIN)
            self._frames = gui.add_checkbox("Frames", initial_value=False)
            self._ghost = gui.add_checkbox("Commanded (ghost)", initial_value=True)
        with gui.add_folder("Last minute"):
            self._joint = gui.add_dropdown("Joint", NO_JOINTS)
            self._strips = Strips(server)
        self._faults, self._servos, self._counters, self._loop, self._controllers = self._tables(gui)
        self._frames.on_update(self._chosen)
        self._ghost.on_update(self._chosen)

    def status(self, text: str, well: bool = True, beat: int = 0) -> None:
        """Show the state of the source, in red if the stack has ended.

        A browser reports a lost connection if it receives no new ``beat`` for ``LOST_S``.
        """
        content = _STATUS.format(text=escape(text), color="inherit" if well else RED, beat=beat)
        if content != self._status.content:
            self._status.content = content

    def show_arm(self, watched: ObservedRobot) -> None:
        """Update the drawn arm, the objects around it and the path of its goal."""
        snapshot = watched.state.snapshot
        if not snapshot.joints or not snapshot.description_xml:
            return
        if (snapshot.description_xml, snapshot.joints) != (self._xml, self._joints):
            self._build(snapshot)
        if self._arm is None:
            return
        self._arm.show(snapshot.position, snapshot.command)
        self._arm.show_things(snapshot.scene)
        self._show_goal(watched, snapshot)
        if self._planned is not None and self._planner is not None:
            newest, now_s = self._planner()
            self._planned.show(newest, snapshot.position, now_s)

    def show_numbers(self, watched: ObservedRobot) -> None:
        """Update the tables, colors and plots.

        Call this method only a few times per second, because the update takes a lot of CPU time.
        """
        snapshot = watched.state.snapshot
        if self._arm is None or self._description is None or snapshot.joints != self._joints:
            return
        temperature_c = health(snapshot).temperature_c
        wanted = shares(self._colors.value, temperature_c, snapshot.effort, self._limits(snapshot))
        self._arm.color(wanted, servo_faults(snapshot))
        self._faults.content = faults(snapshot)
        self._servos.content = servo_table(snapshot, self._description.joints)
        self._counters.content = counter_table(snapshot)
        self._loop.content = loop_table(snapshot)
        self._controllers.content = controller_table(snapshot)
        self._strips.show(watched, self._joints.index(self._joint.value))

    def _tables(self, gui: viser.GuiApi) -> Sequence[viser.GuiHtmlHandle]:
        panel = gui.add_panel()
        with panel.add_tab("Servos"):
            servos = [gui.add_html("") for _ in range(3)]
        with panel.add_tab("Loop"):
            loop = [gui.add_html("") for _ in range(2)]
        panel.dock_left()
        gui.main_panel.dock_right()
        return [*servos, *loop]

    def _build(self, snapshot: RobotSnapshot) -> None:
        """Draw the arm when the page starts or when another arm is connected."""
        if self._arm is not None:
            self._arm.remove()
        if self._planned is not None:
            self._planned.remove()
        self._xml, self._joints, self._goal = snapshot.description_xml, snapshot.joints, None
        self._description = parse_urdf(snapshot.description_xml)
        self._model = DrawnArm(self._description.joints, snapshot.joints)
        if self._model.reach_m > 0.0:
            place_camera(self._server, self._model.reach_m)
        known = known_arm(self._xml, self._folder)
        if known is None:
            visuals, missing = shapes(self._xml)
        else:
            visuals, missing = arm_shapes(self._xml, known.urdf.parent, known.scene.parent)
        around, things = _around(known)
        visuals, around = list(visuals), list(around)
        self._arm = DrawnScene(self._server, self._model, visuals, around, things)
        if self._planner is not None:
            from servoloop.dashboard.planned import PlannedScene

            self._planned = PlannedScene(self._server, self._model, visuals, {shape.link for shape in around})
        self._chosen()
        self._joint.options = snapshot.joints
        if missing:
            names = ", ".join(missing)
            self._server.gui.add_html(
                f"<p style='margin:0.5em 1em'>these meshes cannot be read and are not drawn: {escape(names)}</p>"
            )

    def _chosen(self, _: object = None) -> None:
        """Show or hide the frames and the ghost, depending on the check boxes."""
        if self._arm is not None:
            self._arm.show_frames(self._frames.value)
            self._arm.show_ghost(self._ghost.value)

    def _show_goal(self, watched: ObservedRobot, snapshot: RobotSnapshot) -> None:
        """Draw the path of the latest goal while it is active."""
        going = [goal for goal in snapshot.goals.values() if not goal.ended and self._can_draw(goal)]
        goal = max(going, key=lambda goal: goal.begun_s, default=None)
        if goal is self._goal or self._arm is None or self._model is None:
            return
        self._goal = goal
        points = None if goal is None else self._model.path(goal.joints, goal.positions, watched.start(goal))
        self._arm.show_path(points)

    def _can_draw(self, goal: GoalPath) -> bool:
        """Return whether a goal has several joints, all of which are measured and in the robot description."""
        known = set(self._description.joints if self._description else ()) & set(self._joints)
        return len(goal.joints) > 1 and set(goal.joints) <= known

    def _limits(self, snapshot: RobotSnapshot) -> FloatArray:
        """Return the effort limits (n,) from the robot description, in N m or N."""
        joints = self._description.joints if self._description else {}
        return np.array([joints[name].effort if name in joints else np.inf for name in snapshot.joints])
