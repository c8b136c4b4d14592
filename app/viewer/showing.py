"""What the 3D page shows: the session's contents, the eye, the style, the chosen photograph. Frozen facts, pure steps.

World frame, radians; see orbit.py.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from app.viewer import frusta, orbit
from app.viewer.orbit import Orbit
from app.viewer.protocol import Contents, Style

EVERYTHING, OBJECT = "everything", "object"
_OBJECT_SHARE = 0.55  # of its distance from the camera: a guess at the object's radius


@dataclass(frozen=True, slots=True)
class Showing:
    """One moment of the page."""

    contents: Contents = field(default_factory=lambda: Contents("", ""))
    eye: Orbit = field(default_factory=lambda: Orbit((0.0, 0.0, 0.0), 1.0))
    style: Style = field(default_factory=Style)
    chosen: int = -1  # view; -1: none
    home: bool = True  # the eye was not moved by hand since it was put at home


def opened(before: Showing, contents: Contents, aspect: float) -> Showing:
    """The contents of a session arrived: a new one is seen from home; of one that is shown the eye stays where it is."""
    if contents.folder == before.contents.folder:
        surface = before.style.surface if before.style.surface in contents.surfaces else "shaded"
        style = replace(before.style, surface=surface)
        chosen = before.chosen if 0 <= before.chosen < len(contents.poses) else -1
        kept = replace(before, contents=contents, style=style, chosen=chosen)
        return at_home(kept, aspect) if before.home else kept
    surface = "albedo" if "albedo" in contents.surfaces else "shaded"
    style = replace(before.style, surface=surface, view=-1)
    return at_home(Showing(contents, before.eye, style), aspect)


def at_home(showing: Showing, aspect: float) -> Showing:
    """At the object, as its camera saw it; without a surface from a little above and aside at the cameras, with the room around."""
    contents = showing.contents
    if contents.object_depth > 0 and registered(contents):
        return replace(framed(showing, OBJECT, aspect), home=True)
    azimuth, elevation = orbit.THREE_QUARTERS
    eye = Orbit(contents.centre, 1.0, azimuth, elevation, contents.up, contents.front)
    # Near enough to tell the cameras apart, and far enough that the room is a room.
    radius = min(max(1.25 * contents.radius, 0.25 * contents.room_radius), contents.room_radius)
    return replace(showing, eye=orbit.fitted(eye, contents.centre, radius, aspect), home=True)


def framed(showing: Showing, what: str, aspect: float) -> Showing:
    """The whole room, seen from the same side as now; or the object where the surface stands, from its camera's side: from all
    others the shell that a camera saw shows its edge or its back."""
    contents = showing.contents
    if (
        what == OBJECT
        and contents.object_depth > 0
        and (pose := pose_of(contents, standing(showing))) is not None
    ):
        begun = replace(showing.eye, up=contents.up, front=contents.front)
        seen = orbit.through(begun, pose, contents.object_depth, orbit.FOV)
        eye = orbit.fitted(seen, seen.target, _OBJECT_SHARE * contents.object_depth, aspect)
        eye = replace(eye, roll=seen.roll)
    elif what == OBJECT:
        eye = orbit.fitted(showing.eye, contents.centre, contents.radius, aspect)
    else:
        eye = orbit.fitted(showing.eye, contents.room, contents.room_radius, aspect)
    return moved(showing, replace(eye, fov=orbit.FOV))


def moved(showing: Showing, eye: Orbit) -> Showing:
    """A person moved the eye."""
    return replace(showing, eye=eye, home=False)


def turned_to(showing: Showing, view: str) -> Showing:
    """To one of orbit.VIEWS."""
    return moved(showing, orbit.standing(showing.eye, view))


def chose(showing: Showing, view: int) -> Showing:
    """A photograph is chosen; the surface goes to where it was in that view. -1: none is."""
    if pose_of(showing.contents, view) is None:
        return replace(showing, chosen=-1)
    return replace(showing, chosen=view, style=replace(showing.style, view=view))


def stepped(showing: Showing, by: int) -> Showing:
    """The next or previous registered view, round and round."""
    views = registered(showing.contents)
    if not views:
        return showing
    if showing.chosen not in views:
        return chose(showing, views[0 if by > 0 else -1])
    return chose(showing, views[(views.index(showing.chosen) + by) % len(views)])


def looking_through(showing: Showing) -> Showing:
    """From where the chosen photograph was taken, with its field of view."""
    contents = showing.contents
    pose = pose_of(contents, standing(showing))
    if pose is None:
        return showing
    depth = contents.object_depth or contents.radius
    return moved(showing, orbit.through(showing.eye, pose, depth, contents.fov))


def around(showing: Showing) -> Orbit:
    """The eye as it is, which turns about the object's upright from now on: that of the photograph it stands in, as camera and
    object move together; without a surface that of the room."""
    pose = pose_of(showing.contents, standing(showing))
    if pose is None or showing.contents.object_depth <= 0:
        return showing.eye
    x, y, z = (-float(value) for value in pose[1, :3])
    ahead = tuple(float(value) for value in pose[2, :3])
    upright = replace(showing.eye, up=(x, y, z), front=(ahead[0], ahead[1], ahead[2]))
    return orbit.through(upright, orbit.cam_from_world(showing.eye), showing.eye.distance, showing.eye.fov)


def ride(showing: Showing, count: int) -> list[tuple[Orbit, Style]]:
    """`count` pictures along the cameras' way, in the photographs' order; the surface rides along, as the object did."""
    contents, depth = showing.contents, showing.contents.object_depth or showing.contents.radius
    poses = [np.array(pose).reshape(3, 4) for pose in contents.poses if pose]
    stops = [orbit.through(showing.eye, pose, depth, contents.fov) for pose in poses]
    # What stands in the cameras' own way would run across every picture.
    style, made = with_layer(with_layer(showing, "cameras", False), "axes", False).style, []
    for at in np.linspace(0, len(stops) - 1, count):
        before, after = stops[int(at)], stops[min(int(at) + 1, len(stops) - 1)]
        eye = orbit.between(before, after, float(at) % 1)
        made.append((eye, replace(style, pose=tuple(orbit.cam_from_world(eye).ravel().tolist()))))
    return made


def with_layer(showing: Showing, layer: str, shown: bool) -> Showing:
    visible = [name for name in showing.style.visible if name != layer] + ([layer] if shown else [])
    return replace(showing, style=replace(showing.style, visible=tuple(visible)))


def styled(showing: Showing, **changes: Any) -> Showing:
    return replace(showing, style=replace(showing.style, **changes))


def registered(contents: Contents) -> list[int]:
    return [view for view, pose in enumerate(contents.poses) if pose]


def standing(showing: Showing) -> int:
    """The view in which the surface stands; -1 where no view is registered."""
    views = registered(showing.contents)
    return showing.style.view if showing.style.view in views else (views[0] if views else -1)


def pose_of(contents: Contents, view: int) -> Float[np.ndarray, "3 4"] | None:
    """cam_from_world of a view; None where it is not registered."""
    if not 0 <= view < len(contents.poses) or not contents.poses[view]:
        return None
    return np.array(contents.poses[view]).reshape(3, 4)


def pyramids(showing: Showing) -> tuple[Float[np.ndarray, "n 5 3"], np.ndarray]:
    """The frusta of all views, as long as they are drawn, and which of them exist."""
    contents, length = showing.contents, showing.contents.frustum * showing.style.frusta
    nowhere = (1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0)
    poses = np.array([pose or nowhere for pose in contents.poses]).reshape(-1, 3, 4)
    known = np.array([bool(pose) for pose in contents.poses], bool)
    return frusta.corners(poses, contents.aspect, contents.fov, length), known


def length_text(length: float, unit: str) -> tuple[str, str]:
    """A length for people: the number, and the unit ("m", "cm", "mm", or "" for scene units)."""
    if unit == "m":
        for name, size in (("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("µm", 1e-6)):
            if length >= size * 0.9999 or name == "µm":
                return f"{length / size:.4g}", name
    return f"{length:.4g}", unit
