"""Calibrate an arm whose joints you move by hand. Run: python calibrate_by_hand.py FOLDER PORT"""

import sys
import threading

from commissioning.calibrate.run import JointsToCalibrate, calibrate
from drivers.clock import MonotonicClock
from drivers.port.serial_port import SerialPort
from servoloop.stack.arm_folders import find_arm, read_arm_servos
from servoloop.stack.hardware import servo_bus


class Person:
    """The person at the terminal, who moves the joints and answers the questions."""

    def until_done(self, task, update):
        print(f"{task.text}. Press Enter when done.")
        enter = threading.Thread(target=input, daemon=True)
        enter.start()
        while enter.is_alive():
            update()  # reads the positions

    def confirm(self, question):
        return input(f"{question} [y/n] ") == "y"

    def show(self, differences):
        for one in differences:
            print(f"{one.joint}: zero at {one.made.zero_counts} counts {one.doubt}")

    def say(self, text):
        print(text)


def main(folder, port, person, open_port=SerialPort, clock=None):
    arm, clock = find_arm(folder), clock or MonotonicClock()
    robot = read_arm_servos(arm).robot
    baud = robot.file.lines()[""].baud
    joints = [joint.between_stops() for joint in robot.joints]

    def open_bus():
        return servo_bus(robot.file, open_port(port, baud, clock), clock)

    plans = JointsToCalibrate(arm.robot, joints, arm.file.calibration.joints)
    outcome = calibrate(plans, open_bus, person, clock)
    print(f"stored in {outcome.path}" if outcome.stored else "nothing was stored")


if __name__ == "__main__":
    main(*sys.argv[1:3], Person())
