"""Reactive grasp: forward until a contact, correct by its position, close, lift (F §VI-B).

The paper's hand moves towards a bottle that is not quite in front of it, and corrects itself by
the position of fused contacts; the states and their numbers are ours.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.controller import Command, Controller
from contactfusion.controllers.grasp_contact import HandContact, on_hand, typical
from contactfusion.controllers.grasp_load import CarriedLoad
from contactfusion.controllers.grasp_parameters import ENDS, GraspMode, ReactiveGraspConfig
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.frames import Pose
from contactfusion.hooks import hookimpl
from contactfusion.readings import JointState, Twist
from contactfusion.state import State

NEAR = 0.002
"""Goal tolerance [m]."""
PROGRESS = 0.002
"""The least decrease of the distance to the goal that is progress [m]."""
SLOWING = 4.0
"""Speed of the hand for each metre to the goal, near the goal [1/s]."""
QUIET = 0.2
"""Time at rest after which fingers have stopped [s]."""
NARROW = 0.005
"""The least width between two touched sides [m]."""
STILL_CLOSED = 0.1
"""Share of its travel beyond which a joint of the fingers at rest has not opened."""
LEVEL = 0.7
"""Component along y beyond which a push comes from below or above."""
RECENT = 0.3
"""Time between contacts after which they belong to different touches [s]."""
SILENT = 0.5
"""Time without a reading after which joints are silent [s]."""
ENDED_SOON = (*ENDS, GraspMode.RETREAT, GraspMode.LIFT, GraspMode.LOWER, GraspMode.HOLD)
"""States that a time limit does not end: the object would be dropped."""


@dataclass(frozen=True, eq=False)
class Sense:
    """State of the hand at a step.

    Attributes:
        now: [s].
        tool: the pose of the tool in the frame of the hypothesis space.
        closed: shape (k,), the share of its travel by which each joint of the gripper is closed.
        speeds: shape (k,), of these joints [rad/s, m/s].
        touch: the contact on the hand, or None.
    """

    now: float
    tool: Pose
    closed: FloatArray
    speeds: FloatArray
    touch: HandContact | None

    @property
    def forward(self) -> FloatArray:
        """The forward axis of the tool, shape (3,)."""
        return self.tool[:3, 2]

    @property
    def position(self) -> FloatArray:
        """The position of the tool, shape (3,) [m]."""
        return self.tool[:3, 3]


def _sensed(
    contacts: Sequence[Contact], joints: JointState, state: State, options: ReactiveGraspConfig
) -> Sense:
    """The state of the hand by contacts and joints.

    Args:
        contacts: of one step, in the frame of the hypothesis space.
        joints: of the gripper, and perhaps others.
        state: the robot at the step.
        options: tool and gripper.

    Raises:
        FrameError: the frame of the tool is not known.
        ConfigurationError: a joint of the gripper, or its velocity, is not reported.
    """
    for name in options.gripper:
        if name not in joints.names:
            hint = name_hint(name, joints.names, "joints")
            raise ConfigurationError(f"unknown joint '{name}': {hint}", f"gripper.{name}")
    rows = [joints.names.index(name) for name in options.gripper]
    if joints.velocities is None or np.isnan(joints.velocities[rows]).any():
        raise ConfigurationError(
            "the joints report no velocities, which show whether the fingers are at rest", "gripper"
        )
    opened, closed = np.array(list(options.gripper.values())).T
    tool = state.frames.pose(state.grid.frame, of=options.tool)
    return Sense(
        now=state.now,
        tool=tool,
        closed=(joints.positions[rows] - opened) / (closed - opened),
        speeds=joints.velocities[rows],
        touch=on_hand(contacts, tool, state.surface, options.hand),
    )


@final
class Move:
    """A motion of the hand, and whether its fingers are at rest.

    Args:
        now: its start [s].
        goal: target position of the tool, shape (3,) [m], in the frame of the hypothesis space;
            None: the hand rests.
        options: speeds and patience.
    """

    def __init__(self, now: float, goal: FloatArray | None, options: ReactiveGraspConfig) -> None:
        self.began, self.goal, self._options = now, goal, options
        self._left, self._nearest = np.inf, np.inf
        self._now = self._nearer = self._moved = now

    def follow(self, sense: Sense) -> None:
        """Update the progress of the hand, and the rest of its fingers."""
        self._now = now = sense.now
        if (np.abs(sense.speeds) > self._options.resting).any():
            self._moved = now
        if self.goal is None:
            return
        self._left = float(np.linalg.norm(self.goal - sense.position))
        if self._left < self._nearest - PROGRESS:
            self._nearest, self._nearer = self._left, now

    @property
    def is_there(self) -> bool:
        """Whether the hand has reached its goal."""
        return self._left < NEAR

    @property
    def is_blocked(self) -> bool:
        """Whether the hand makes no progress."""
        return self.goal is not None and self._now - self._nearer > self._options.patience

    @property
    def fingers_rest(self) -> bool:
        """Whether the fingers have had time to start, and are at rest."""
        return min(self._now - self._moved, self._now - self.began - QUIET) > QUIET

    def velocity(self, sense: Sense) -> FloatArray:
        """Velocity of the tool in its own frame, shape (3,) [m/s]."""
        if self.goal is None:
            return np.zeros(3)
        offset = sense.tool[:3, :3].T @ (self.goal - sense.position)
        left = max(float(np.linalg.norm(offset)), 1e-9)
        velocity: FloatArray = offset / left * min(self._options.speed, SLOWING * left)
        return velocity


@final
class Between:
    """Bisection between positions of contacts on opposite sides of the object.

    The object is wider than assumed: the hand moves to the middle, not past the other contact.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Drop all contacts, as after the object may have been moved."""
        self._low, self._high = -np.inf, np.inf

    def shift(self, here: float, wanted: float) -> float:
        """The lateral shift of the hand [m].

        Args:
            here: lateral position of the contact [m].
            wanted: shift by this contact alone [m].
        """
        low, high = (here, self._high) if wanted > 0.0 else (self._low, here)
        if high - low < NARROW:  # the object has been pushed laterally meanwhile
            low, high = (here, np.inf) if wanted > 0.0 else (-np.inf, here)
        self._low, self._high = low, high
        return wanted if low < here + wanted < high else (low + high) / 2.0 - here


class ReactiveGrasp(Controller):
    """Grasps an object in front of the hand, by contacts and joints alone."""

    Config = ReactiveGraspConfig

    def __init__(self, config: ReactiveGraspConfig) -> None:
        super().__init__(config)
        self.options = config
        self._states: dict[str, Callable[[Sense, Move], None]] = {
            GraspMode.OPEN: self._open,
            GraspMode.APPROACH: self._approach,
            GraspMode.BACK: self._back,
            GraspMode.ASIDE: self._lateral,
            GraspMode.ENTER: self._enter,
            GraspMode.CLOSE: self._close,
            GraspMode.LIFT: self._lift,
            GraspMode.LOWER: self._lower,
            GraspMode.HOLD: self._hold,
            GraspMode.RETREAT: self._retreat,
        }
        self.reset()

    def reset(self) -> None:
        """Restart, with the gripper as it is."""
        self._mode, self._reason = GraspMode.WAIT, "no joints yet"
        self._began: float | None = None
        self._move: Move | None = None
        self._gripper: float | None = None
        self._start = np.zeros(3)
        self._shift, self._held = np.zeros(3), np.zeros(0)
        self._taken = np.zeros(3)
        self._touches = list[tuple[float, HandContact]]()
        self._between = Between()
        self._corrections, self._attempt = 0, 1
        self._end = GraspMode.MISSED
        self._load = CarriedLoad(self.options.wrist) if self.options.wrist else None

    def command(self, contacts: Sequence[Contact], state: State) -> Command:
        """Velocity of the tool and opening of the gripper, by the contacts.

        Raises:
            FrameError: the frame of the tool is not known.
            ConfigurationError: a joint of the gripper is not reported.
        """
        options, now = self.options, state.now
        if self._mode in ENDS:
            return self._command(now, np.zeros(3))
        self._began = now if self._began is None else self._began
        if state.joints is None or now - state.joints.stamp > SILENT:
            if state.joints is not None:
                self._mode, self._reason = GraspMode.BLIND, f"joints are silent for {SILENT:g} s"
            elif now - self._began > options.patience:
                self._mode, self._reason = GraspMode.BLIND, "no reading of the joints has come"
            return self._command(now, np.zeros(3))
        sense = _sensed(contacts, state.joints, state, options)
        if self._load:
            self._load.feel(state.wrenches, now)
        if self._move is None:
            self._start = sense.position
            move = self._go(GraspMode.OPEN, "it begins", sense, gripper=0.0)
        else:
            move = self._move
        move.follow(sense)
        if now - self._began > options.longest and self._mode not in ENDED_SOON:
            self._fail(GraspMode.TIMEOUT, f"not done after {options.longest:g} s", sense)
        if self._mode in self._states:
            self._states[self._mode](sense, self._moving)
        return self._command(now, self._moving.velocity(sense))

    def _open(self, sense: Sense, move: Move) -> None:
        going = move.goal is not None and not (move.is_there or move.is_blocked)
        if going or not move.fingers_rest:
            return
        if (sense.closed > STILL_CLOSED).any():
            name = list(self.options.gripper)[int(sense.closed.argmax())]
            self._fail(GraspMode.STUCK, f"'{name}' does not open", sense)
            return
        if self._load and self._attempt == 1:
            self._load.tare()
        self._approach_from(sense, f"attempt {self._attempt}")

    def _approach(self, sense: Sense, move: Move) -> None:
        feels = self.options.corrections > 0 and sense.now - move.began >= self.options.settle
        if feels and sense.touch is not None:
            if self._touches and sense.now - self._touches[-1][0] > RECENT:
                self._touches.clear()
            self._touches.append((sense.now, sense.touch))
        if len(self._touches) >= self.options.confirm:
            self._touched(sense, typical([touch for _, touch in self._touches]))
        elif move.is_there:
            self._go(GraspMode.CLOSE, "at the end of the way", sense, gripper=1.0)
        elif move.is_blocked:
            self._fail(GraspMode.BLOCKED, "the hand comes no further", sense)

    def _touched(self, sense: Sense, touch: HandContact) -> None:
        """Close, enter, or correct, by the position of a contact."""
        options, (lateral, _, forward) = self.options, touch.position
        felt = f"touched {100.0 * lateral:+.1f} cm aside, {100.0 * forward:.1f} ahead"
        felt += f" ({', '.join(touch.sources)})"
        middle, _, depth = touch.middle(options.hand.radius).tolist()
        vertical = abs(touch.push[1]) > LEVEL
        if not vertical and abs(middle) <= options.inside:
            goal = sense.position + max(depth - options.depth, 0.0) * sense.forward
            self._go(GraspMode.ENTER, f"{felt}: between the fingers", sense, goal)
            return
        if vertical:
            self._shift = np.array([0.0, np.copysign(options.raised, touch.push[1]), 0.0])
        else:
            wanted = float(np.clip(middle, -options.aside, options.aside))
            here = float(sense.position @ sense.tool[:3, 0])
            self._shift = np.array([self._between.shift(here, wanted), 0.0, 0.0])
        if self._corrections < options.corrections:
            self._corrections += 1
            goal = sense.position - options.back * sense.forward
            self._go(GraspMode.BACK, felt, sense, goal)
        elif vertical:
            self._fail(GraspMode.OBSTRUCTED, f"{felt}, by what is below or above", sense)
        else:
            self._go(GraspMode.CLOSE, f"{felt}; no correction left", sense, gripper=1.0)

    def _enter(self, sense: Sense, move: Move) -> None:
        if move.is_there or move.is_blocked:
            self._go(GraspMode.CLOSE, self._reason, sense, gripper=1.0)

    def _back(self, sense: Sense, move: Move) -> None:
        if move.is_there or move.is_blocked:
            goal = sense.position + sense.tool[:3, :3] @ self._shift
            lateral, up, _ = 100.0 * self._shift
            shift = f"{up:+.1f} cm up" if up else f"{lateral:+.1f} cm aside"
            self._go(GraspMode.ASIDE, f"correction {self._corrections}: {shift}", sense, goal)

    def _lateral(self, sense: Sense, move: Move) -> None:
        if move.is_there or move.is_blocked:
            self._approach_from(sense, f"after correction {self._corrections}")

    def _close(self, sense: Sense, move: Move) -> None:
        if not move.fingers_rest and sense.now - move.began < self.options.closing:
            return
        if (sense.closed >= self.options.empty).all():
            self._miss(sense)
            return
        self._held, self._taken = sense.closed, sense.position
        if self._load:
            self._load.begin()
        goal = sense.position + self.options.lift * sense.tool[:3, 1]
        self._go(GraspMode.LIFT, f"fingers rest {sense.closed.mean():.0%} closed", sense, goal)

    def _miss(self, sense: Sense) -> None:
        """Try again, or give up; a missed object may have been pushed forward."""
        reason = "the fingers closed on nothing"
        if not self._another():
            self._fail(GraspMode.MISSED, reason, sense)
            return
        goal = sense.position - 2.0 * self.options.back * sense.forward
        self._go(GraspMode.OPEN, reason, sense, goal, gripper=0.0)

    def _another(self) -> bool:
        """Begin another attempt; False: none is left."""
        if self._attempt == self.options.attempts:
            return False
        self._attempt += 1
        self._between.forget()  # the fingers may have moved the object
        return True

    def _lift(self, sense: Sense, move: Move) -> None:
        if self._slipped(sense):
            return
        if move.is_there:
            self._go(GraspMode.HOLD, "high enough", sense)
        elif move.is_blocked:  # the object would fall from here
            self._put_down(GraspMode.BLOCKED, "the hand comes no higher", sense)

    def _put_down(self, end: GraspMode, reason: str, sense: Sense) -> None:
        self._end = end
        self._go(GraspMode.LOWER, reason, sense, self._taken)

    def _lower(self, sense: Sense, move: Move) -> None:
        if move.is_there or move.is_blocked:
            again = self._end is GraspMode.DROPPED and self._another()
            self._fail(GraspMode.OPEN if again else self._end, self._reason, sense)

    def _hold(self, sense: Sense, move: Move) -> None:
        if not self._slipped(sense) and sense.now - move.began >= self.options.hold:
            self._go(GraspMode.LIFTED, f"held for {self.options.hold:g} s", sense)

    def _retreat(self, sense: Sense, move: Move) -> None:
        """Open first, for the fingers would drag along the object between them; then move back."""
        if move.goal is None:
            if move.fingers_rest or sense.now - move.began > self.options.closing:
                gone = (sense.position - self._start) @ sense.forward
                goal = sense.position - gone * sense.forward
                self._move = Move(sense.now, goal, self.options)
        elif move.is_there or move.is_blocked:
            self._go(self._end, self._reason, sense)  # the gripper is open, also for another try

    def _approach_from(self, sense: Sense, reason: str) -> None:
        reach = self.options.reach + (self._attempt - 1) * self.options.back
        left = reach - float((sense.position - self._start) @ sense.forward)
        goal = sense.position + max(left, 0.0) * sense.forward
        self._touches.clear()
        self._go(GraspMode.APPROACH, reason, sense, goal)

    def _fail(self, end: GraspMode, reason: str, sense: Sense) -> None:
        self._end = end
        self._go(GraspMode.RETREAT, reason, sense, gripper=0.0)

    def _slipped(self, sense: Sense) -> bool:
        height = float((sense.position - self._taken) @ sense.tool[:3, 1])
        felt = self._load.slip(height) if self._load else None
        if felt is not None:
            if felt:
                self._put_down(GraspMode.DROPPED, felt, sense)
            return bool(felt)
        slipped = bool((sense.closed - self._held > self.options.slip).any())
        if slipped:
            self._fail(GraspMode.DROPPED, "the fingers closed further", sense)
        return slipped

    def _go(
        self,
        mode: GraspMode,
        reason: str,
        sense: Sense,
        goal: FloatArray | None = None,
        gripper: float | None = None,
    ) -> Move:
        """Enter a state, with the hand to move to a goal, or to rest."""
        self._mode, self._reason = mode, reason
        self._gripper = self._gripper if gripper is None else gripper
        self._move = Move(sense.now, goal, self.options)
        return self._move

    @property
    def _moving(self) -> Move:
        assert self._move is not None
        return self._move

    def _command(self, now: float, velocity: FloatArray) -> Command:
        twist = Twist(stamp=now, frame=self.options.tool, linear=velocity, angular=np.zeros(3))
        return Command(
            twist=twist, gripper=self._gripper, mode=str(self._mode), reason=self._reason
        )


@hookimpl
def contactfusion_controllers() -> Mapping[str, type[ReactiveGrasp]]:
    """Reactive grasping."""
    return {"reactive_grasp": ReactiveGrasp}
