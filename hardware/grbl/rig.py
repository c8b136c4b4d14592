"""A rig on a GRBL 1.1, grblHAL or FluidNC controller: homed, moved, held, stopped, and not believed once it may be lost.

Source: GRBL 1.1 documentation, "Interface", "Real-time Commands", "Jogging".

Moves are G1 lines, not jogs: that one has ended is then known by the `ok` to a dwell, which comes after all motion (and
which GRBL refuses while it jogs). `stop` sends a feed hold at once; once the controller reports Hold:0 its queue is
emptied by a soft reset, which at rest keeps the position: after a stop the rig need not be homed. Homing can only be
stopped by a reset in motion, which loses the position. The same halt follows any move that failed, so that nothing is
queued and no late answer can be taken for another; and wherever the controller says it stands must then be on the way
it was sent, or its position counts as lost. GRBL cannot notice a motor that stalls; homing again sets that right.
"""

import contextlib
import threading
from collections.abc import Callable, Iterator

from hardware.errors import (
    DisconnectedError,
    HardwareError,
    PositionLostError,
    RefusedError,
    ReplyError,
    StoppedError,
)
from hardware.grbl import codes as grbl_codes
from hardware.grbl.config import GrblConfig
from hardware.grbl.link import HOME, MODES, POLL_S, GrblLink, Reply, Restarted
from hardware.grbl.path import Place, Way, travel_s
from hardware.grbl.place import Whereabouts
from hardware.grbl.status import LOCKED, Alarm, Banner, Report
from hardware.grbl.travel import Found, Travel
from hardware.interfaces import Angles, Motion, MotionFeatures, MotionStatus, State

SETTLE = "G4P0.01"
STATUS_S = 0.3
REST_S = 3.0  # beyond the time that braking takes
MARGIN_S = 5.0
_MOST_OFFSET_REPORTS = 40  # WCO comes with every 10th or 30th


class Grbl(Motion):
    """See the module, and `hardware.grbl.opening.open_grbl`, which makes it."""

    def __init__(self, config: GrblConfig, link: GrblLink, found: Found, clock: Callable[[], float]):
        self._config, self._link, self._found, self._clock = config, link, found, clock
        self._travel = Travel(config, found.settings)
        self._where = Whereabouts(self._travel, link.port)
        self._axes = len(config.axes)
        self._order_lock = threading.Lock()
        self._doing: State | None = None
        self._closed = False
        self._holdable = False  # a move is under way
        self._holding = False  # it was last asked to pause
        self._resuming = 0  # it was last asked to go on: reports to come that may still not show it
        self._last = MotionStatus(State.UNHOMED, None, self._where.lost)

    @property
    def name(self) -> str:
        return f"{self._found.version} on {self._link.port}"

    @property
    def features(self) -> MotionFeatures:
        homes = self._config.homing == "switches"
        return MotionFeatures(
            self._travel.axes(), automatic=True, homes=homes, holds=True, reports_angles=True
        )

    # -- from any thread

    def status(self) -> MotionStatus:
        if self._closed:
            return MotionStatus(State.OFFLINE, None, "the port is closed")
        if not self._order_lock.acquire(blocking=False):
            doing = self._doing  # the order asks ten times a second; None: another thread asks just now
            return self._last if doing is None else self._told(doing)
        try:
            self._last = self._asked()
            return self._last
        finally:
            self._order_lock.release()

    def _asked(self) -> MotionStatus:
        try:
            self._link.drain(self._notice)
            report = self._link.look(self._notice, STATUS_S)
        except ReplyError as error:
            if self._where.fault:  # after a limit alarm GRBL keeps silent until it is reset
                return MotionStatus(State.FAULT, None, self._where.lost)
            return MotionStatus(State.OFFLINE, None, str(error))
        except DisconnectedError as error:
            return MotionStatus(State.OFFLINE, None, str(error))
        except HardwareError:
            return self._told(State.FAULT)
        return self._told(State.MOVING if report.state in ("Run", "Jog", "Home") else State.IDLE)

    def _told(self, doing: State) -> MotionStatus:
        report = self._link.report
        if doing is State.HOMING:
            return MotionStatus(State.HOMING, None)
        if self._where.lost:
            return MotionStatus(State.FAULT if self._where.fault else State.UNHOMED, None, self._where.lost)
        angles = self._angles(self._where.place)
        if report is not None and report.paused and not self._link.hold_left:
            return MotionStatus(State.HELD, angles, "the door is open" if report.state == "Door" else "")
        return MotionStatus(doing, angles, "; ".join(self._found.notes))

    def stop(self) -> None:
        self._holding, self._resuming = False, 0
        if not self._closed:
            self._link.stop()

    def hold(self) -> None:
        with self._link.gate:
            if self._holdable and not self._link.hold_left:
                self._holding, self._resuming = True, 0
                self._link.request(b"!")

    def resume(self) -> None:
        with self._link.gate:
            if not self._link.hold_left:
                # Of two reports the first may answer a question from before.
                self._holding, self._resuming = False, 2 if self._order_lock.locked() else 0
                self._link.request(b"~")

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        if not self._order_lock.acquire(blocking=False):
            with contextlib.suppress(DisconnectedError):
                self._link.stop()
            if not self._order_lock.acquire(timeout=REST_S + MARGIN_S):
                self._link.line.close()
                return
        self._order_lock.release()
        self._link.line.close()

    # -- orders

    def home(self) -> Angles:
        with self._order(State.HOMING):
            self._where.unsure()
            self._restart()
            zero = self._config.home_deg[: self._axes]
            if self._config.homing == "switches":
                self._link.exchange([HOME], self._travel.homing_s(), self._obey)
            elif self._link.report is not None and self._link.report.state == "Alarm":
                self._link.exchange(["$X"], MARGIN_S, self._obey)
            self._link.exchange(["G54G21G90G94"], MARGIN_S, self._obey)
            if self._config.homing == "none" or self._travel.differ(self._placed(), zero):
                words = "".join(f"{letter}{angle:.4f}" for letter, angle in zip("XY", zero, strict=False))
                self._link.exchange([f"G10L20P1{words}"], MARGIN_S, self._obey)
            place = self._placed()
            if self._travel.differ(place, zero):
                raise ReplyError(f"{self._link.port}: homed, but it stands at {place}, not {zero}; try again")
            self._where.homed(place)
            return self._angles(place)

    def move(self, angles: Angles) -> Angles:
        target = self._travel.reachable(angles, self._offset(), self._link.port)
        with self._order(State.MOVING):
            if self._where.lost:
                raise PositionLostError(
                    f"{self._link.port}: the position is unknown: {self._where.lost}; home the rig"
                )
            start = self._ready()
            way = Way.to(target, start, self._config.backlash_deg, self._where.loaded)
            self._go(start, way)
            report = self._rest()
            if not self._where.arrived(target):
                place = self._where.place
                raise ReplyError(
                    f"{self._link.port}: sent to {target} it stands at {place} ({report.state}); try again"
                )
            self._where.stands(loaded=True)
            return self._angles(self._where.place)

    @contextlib.contextmanager
    def _order(self, doing: State) -> Iterator[None]:
        """One at a time; what an order that fails has lost is remembered."""
        with self._order_lock:
            if self._closed:
                raise DisconnectedError(f"{self._link.port}: the port is closed; open the rig again")
            self._link.begin(homing=doing is State.HOMING)
            self._doing, self._holdable = doing, doing is State.MOVING
            try:
                yield
            except PositionLostError as error:
                if not self._where.lost or doing is State.HOMING:  # not if it only was never homed
                    self._where.lose_by(error)
                raise
            except DisconnectedError as error:
                self._where.lose_by(error)
                raise
            except ReplyError:
                if doing is State.HOMING:
                    self._link.abort()  # it may be homing still
                raise
            finally:
                self._link.begin(homing=False)
                with self._link.gate:
                    self._holdable, self._holding, self._resuming = False, False, 0
                self._doing = None
                self._last = self._told(State.IDLE)

    # -- parts of orders

    def _go(self, start: Place, way: Way) -> None:
        """Along the way, until all motion has ended; if that fails it is stopped, as far as it listens."""
        corners = [start, *way.corners]
        allowed_s = MARGIN_S + 2 * travel_s(corners, self._config.feed_deg_min, self._found.settings)
        self._where.departs(corners)
        try:
            self._link.exchange([*map(self._line, way.corners), SETTLE], allowed_s, self._obey)
        except HardwareError as error:
            if not isinstance(error, PositionLostError | DisconnectedError):
                self._recover()
            raise
        with self._link.gate:
            self._holdable = False

    def _ready(self) -> Place:
        """Cleared of what an earlier order left, idle, and where it was left; returns that place."""
        if self._link.hold_left:
            self._halt()
        self._link.drain(self._obey)
        report = self._link.look(self._obey)
        if report.state == "Hold" and (self._holding or self._resuming):
            report = self._rest()
        if report.state != "Idle":
            raise RefusedError(
                f"{self._link.port}: the controller is in state {report.state}; end the hold, door, check mode or"
                " tool change that was begun at the machine, then try again"
            )
        if self._link.offset is None:
            self._placed()
        self._where.must_be_on_way()
        return self._where.place

    def _recover(self) -> None:
        """Halt after a move that failed; if that is impossible just now, the next order begins with it."""
        try:
            self._halt()
        except ReplyError:
            self._link.hold_left = True

    def _halt(self) -> None:
        """Hold, wait until it stands, forget what is queued; the place stays known.

        Raises:
            PositionLostError: it was moving when it was reset, or is not where it can be.
            ReplyError: it does not answer.
        """
        stops = self._link.stops
        self._link.hold()
        feed, acceleration = self._config.feed_deg_min / 60, self._found.settings.get(120, 10.0)
        end = self._clock() + REST_S + feed / acceleration
        while True:
            report = self._link.look(self._notice)
            if not report.moving and report.state != "Idle":
                break
            if self._clock() >= end:
                raise ReplyError(
                    f"{self._link.port}: it does not stand still ({report.state}); cut its power"
                )
            self._link.listen(POLL_S, self._notice)
            if report.state == "Idle":
                self._link.hold()  # it was jogging, which a hold only cancels; or the first one was lost
        before = report.place if report.machine else None
        self._link.reset(self._notice)
        report = self._link.look(self._notice)
        if before is not None and report.machine and report.place != before:
            raise self._where.lose("its position changed while it was stopped")
        self._placed()
        self._where.must_be_on_way()
        self._where.stands(loaded=False)
        if report.state == "Idle":  # otherwise it was told to hold once more
            self._link.cleared(stops)

    def _restart(self) -> None:
        """A controller in no matter what state, made to listen; whether it is locked shows in its next report."""
        for attempt in range(3):
            stops = self._link.stops
            try:
                self._link.reset(self._tolerate)
                self._link.look(self._obey_locked)
                self._link.exchange([MODES], MARGIN_S, self._obey_locked)
            except PositionLostError:  # it was starting already: that message came first
                if attempt == 2:
                    raise
            else:
                self._link.cleared(stops)
                return

    def _rest(self) -> Report:
        """Wait out a hold that was asked for just before or just after the motion."""
        end = self._clock() + MARGIN_S
        while True:
            report = self._link.look(self._obey)
            if report.state == "Idle" or (not report.paused and self._clock() >= end):
                return report
            self._link.listen(POLL_S, self._obey)

    def _placed(self) -> Place:
        """A place told after the present offset was."""
        self._link.drain(self._obey)
        for _ in range(_MOST_OFFSET_REPORTS):
            report = self._link.look(self._obey)
            place = self._link.place(report)
            if place is not None:
                return place
        raise ReplyError(f"{self._link.port}: the controller does not report WCO; enable it, or set $10=0")

    def _line(self, corner: Place) -> str:
        words = "".join(f"{letter}{angle:.4f}" for letter, angle in zip("XY", corner, strict=False))
        return f"G54G90G21G94G1{words}F{self._config.feed_deg_min:.1f}"

    # -- judging what is heard

    def _notice(self, reply: Reply | None) -> None:
        """Take note of reports; alarms and resets that we did not ask for lose the position."""
        if isinstance(reply, Alarm):
            raise self._where.lose_by(self._alarm(reply.code))
        if isinstance(reply, Banner):
            raise self._where.lose("the controller was reset or lost power; check its supply")
        if not isinstance(reply, Report):
            return
        if reply.state in LOCKED and self._doing is not State.HOMING and not self._where.lost:
            if reply.sub:
                raise self._where.lose_by(self._alarm(reply.sub))
            raise self._where.lose(f"the controller is in state {reply.state}")
        if (place := self._link.place(reply)) is not None:
            self._where.seen(place)
        if self._resuming and reply.paused:
            self.resume()  # the first `~` came while it was still slowing down
        elif reply.state in ("Run", "Idle"):
            with self._link.gate:
                self._resuming = max(0, self._resuming - 1)

    def _obey(self, reply: Reply | None) -> None:
        """Notice, and end the order when `stop` was called."""
        if self._link.stopped:
            raise StoppedError(f"{self._link.port}: stopped on request; move again to go on")
        self._notice(reply)

    def _obey_locked(self, reply: Reply | None) -> None:
        """grblHAL tells after every start which alarm still stands; homing ends it, or says why it cannot."""
        if not isinstance(reply, Alarm):
            self._obey(reply)

    def _tolerate(self, reply: Reply | None) -> None:
        """Before homing nothing that is heard matters, but a stop does."""
        if self._link.stopped and not isinstance(reply, Restarted):
            raise StoppedError(f"{self._link.port}: stopped on request; home the rig to go on")

    def _alarm(self, number: int) -> PositionLostError:
        return grbl_codes.alarm(number, self._link.port, self._link.firmware)

    # -- places

    def _angles(self, place: Place) -> Angles:
        return Angles(place[0], place[1] if self._axes == 2 else 0.0)

    def _offset(self) -> Place | None:
        """WCO in degrees, where it is that of the homed rig."""
        offset = self._link.offset
        return (
            None if offset is None or self._where.lost else tuple(self._link.unit * value for value in offset)
        )
