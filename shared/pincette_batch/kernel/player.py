"""Playing a program: the controller's guards, segments and references, where all goes well.

Each function is the one of the same name in the controller's ``player``, ``guarding``,
``steering`` and ``references``; what leads off the program's course ends the lane instead.
"""

from pincette.control.planning.contact_line import ContactLine
from pincette.control.planning.profiles import Quintic, move, quintic
from pincette_batch.kernel.constants import Play
from pincette_batch.kernel.lane import Ending, LaneRecord

KIND_ZERO, KIND_FREE, KIND_SEEK, KIND_FORCE, KIND_PATH = range(5)
KINDS = {"zero": 0, "free": 1, "seek": 2, "force": 3, "path": 4}

NO_CONTACT, OVERFORCE, LOST = int(Ending.NO_CONTACT), int(Ending.OVERFORCE), int(Ending.LOST)
NO_LINE, ZERO_REFUSED = int(Ending.NO_LINE), int(Ending.ZERO_REFUSED)

add_to_line, fit_line = ContactLine.add, ContactLine.fit
position, speed = Quintic.position, Quintic.speed


def advance(k: Play, lane: LaneRecord, line: ContactLine) -> ContactLine:
    """Move on by one tick: guards first, then time, then the references of the next sample."""
    lane.zero = lane.bump = False
    line = guard(k, lane, line)
    while lane.ending == 0 and not lane.ended and is_over(k, lane):
        leave(k, lane, line)
    if lane.ending == 0 and not lane.ended:
        lane.ticks += 1
        set_references(k, lane)
    return line


def guard(k: Play, lane: LaneRecord, line: ContactLine) -> ContactLine:
    """Judge the newest sample."""
    segment = k.segments[lane.index]
    if lane.zeroed and lane.force_mN > k.force_max_mN:
        lane.ending = OVERFORCE
    elif lane.zeroing:
        # The estimator has answered the zero before the controller plays on.
        lane.zeroing = False
        go_on(k, lane)
    elif segment.kind == KIND_SEEK:
        seek(k, lane)
    elif segment.loads:
        line = add_to_line(line, lane.x_um, lane.force_mN, lane.force_r_mN)
    elif segment.presses and segment.watched:
        watch_part(k, lane)
    return line


def seek(k: Play, lane: LaneRecord) -> None:
    """Wait for a force that is none of an error."""
    if lane.force_mN < k.contact_force_mN:
        lane.count = 0
    elif lane.count + 1 < k.contact_samples:
        lane.count += 1
    else:
        lane.contact_x_um = lane.x_um - lane.force_mN / k.planned_mN_per_um
        lane.stiffness_mN_per_um, lane.known_contact = k.planned_mN_per_um, True
        lane.x_r_um, lane.force_r_mN = lane.x_um, lane.force_mN
        lane.speed_um_per_s = 0.0
        lane.held = lane.bump = True
        enter(k, lane, lane.index + 1)


def watch_part(k: Play, lane: LaneRecord) -> None:
    """See whether the part is still there."""
    passing = not k.segments[lane.index].holds
    light = passing and lane.force_r_mN < 2.0 * k.contact_force_mN
    if light or lane.force_mN >= k.lost_fraction * lane.force_r_mN:
        lane.count = 0
    elif lane.count + 1 < k.lost_samples:
        lane.count += 1
    else:
        lane.ending = LOST


def is_over(k: Play, lane: LaneRecord) -> bool:
    """Whether the segment has run its time."""
    if lane.zeroing:
        return False
    return lane.ticks * k.period_s >= k.segments[lane.index].duration_s - 0.5 * k.period_s


def leave(k: Play, lane: LaneRecord, line: ContactLine) -> None:
    """Leave a segment that has run its time."""
    kind = k.segments[lane.index].kind
    if kind == KIND_ZERO:
        lane.zero = lane.zeroing = True
        lane.count = 0
    elif kind == KIND_SEEK:
        lane.ending = NO_CONTACT
    else:
        if k.segments[lane.index].loads and k.identifies:
            settle_contact(k, lane, line)
        if lane.ending == 0:
            go_on(k, lane)


def settle_contact(k: Play, lane: LaneRecord, line: ContactLine) -> None:
    """Take the contact line as fitted over the load."""
    fit = fit_line(line, 0.1)
    if fit is None:
        lane.ending = NO_LINE
        return
    lane.contact_x_um, lane.stiffness_mN_per_um = fit.x_e_um, fit.K_e_mN_per_um
    K_e = fit.K_e_mN_per_um
    if not k.stiffness_min_mN_per_um <= K_e <= k.stiffness_max_mN_per_um:
        lane.ending = NO_LINE


def go_on(k: Play, lane: LaneRecord) -> None:
    """Enter the segment after this one, or end."""
    following = lane.index + 1
    if following >= len(k.segments):
        lane.ended = True
        return
    if k.segments[lane.index].presses and not k.segments[following].presses:
        # Without a contact the law gets no force any more, and x_r starts from x.
        lane.held, lane.bump = False, True
        lane.x_r_um, lane.force_r_mN = lane.x_um, 0.0
    enter(k, lane, following)


def enter(k: Play, lane: LaneRecord, following: int) -> None:
    """Stand at the begin of a segment, with references as they are."""
    lane.index = following
    lane.pressing = k.segments[following].presses
    lane.ticks = lane.count = 0
    lane.from_x_um, lane.from_speed_um_per_s = lane.x_r_um, lane.speed_um_per_s
    lane.from_force_mN = lane.force_r_mN


def set_references(k: Play, lane: LaneRecord) -> None:
    """References at ``ticks`` of the segment: for the sample that the coming voltage leads to."""
    segment, t_s = k.segments[lane.index], lane.ticks * k.period_s
    kind, duration_s = segment.kind, segment.duration_s
    if kind == KIND_FREE:
        path = move(lane.from_x_um, lane.from_speed_um_per_s, segment.x_to_um, 0.0, duration_s)
        lane.x_r_um, lane.speed_um_per_s = position(path, t_s), speed(path, t_s)
    elif kind == KIND_SEEK:
        lane.speed_um_per_s = (segment.x_to_um - lane.from_x_um) / duration_s
        lane.x_r_um = lane.from_x_um + lane.speed_um_per_s * t_s
    elif kind == KIND_FORCE:
        press(k, lane, t_s)
    elif kind == KIND_PATH:
        track(k, lane)
    else:
        lane.speed_um_per_s = 0.0


def press(k: Play, lane: LaneRecord, t_s: float) -> None:
    """Move F_r and x_r together along the contact line."""
    duration_s, force_to_mN = k.segments[lane.index].move_s, k.segments[lane.index].force_to_mN
    share = quintic(t_s / duration_s) if duration_s > 0.0 else 1.0
    x_to_um = lane.contact_x_um + force_to_mN / lane.stiffness_mN_per_um
    lane.x_r_um = lane.from_x_um + share * (x_to_um - lane.from_x_um)
    lane.force_r_mN = lane.from_force_mN + share * (force_to_mN - lane.from_force_mN)
    lane.speed_um_per_s = 0.0


def track(k: Play, lane: LaneRecord) -> None:
    """Follow a path, in force along the contact line or in position."""
    segment = k.segments[lane.index]
    place = segment.path + lane.ticks
    if segment.presses:
        value = k.values[place]
        lane.x_r_um = lane.contact_x_um + value / lane.stiffness_mN_per_um
        lane.force_r_mN, lane.speed_um_per_s = value, 0.0
    else:
        lane.x_r_um, lane.speed_um_per_s = k.values[place], k.rates[place]
