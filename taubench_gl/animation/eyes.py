"""The other eye of a stereo camera: a second view of the same state, whose image can be the history of the first."""

from __future__ import annotations

from dataclasses import dataclass, replace

from taubench_gl.animation.recorded_camera import RecordedCamera
from taubench_gl.animation.state import FrameState, View
from taubench_gl.animation.views import ORBIT, CameraTrack, FileCamera, choose_camera
from taubench_gl.errors import SettingsError
from taubench_gl.scene.model import Scene
from taubench_gl.settings import EYES, Settings


@dataclass(frozen=True, slots=True)
class EyeCamera:
    """A camera ``offset`` scene units to the right of another one, with the same axes.

    ``convergence``: distance at which both images show a point at the same pixel, scene units; None: infinitely far.
    The image is shifted for it (an off-axis projection), not turned, so that points never move up or down.
    """

    camera: CameraTrack
    offset: float
    convergence: float | None = None
    name: str = "the other eye"

    def describe(self) -> str:
        """Short description, without lengths, whose unit is not known here."""
        return f"{self.name} of {self.camera.describe()}"

    def view_at(self, state: FrameState) -> View:
        """The view at ``state.time``."""
        return self.beside(self.camera.view_at(state))

    def beside(self, view: View) -> View:
        """The other eye of ``view``.  Parallel projections show every depth with the same shift and have none."""
        shifted = self.convergence is not None and not view.camera.parallel
        position = view.position + self.offset * view.world_from_view[:, 0]
        shift = view.shift - self.offset / self.convergence if shifted else view.shift
        return replace(view, position=position, shift=shift)


def other_eye(scene: Scene, camera: CameraTrack, settings: Settings) -> CameraTrack:
    """The camera whose image is the history of ``camera`` where ``history`` is ``eye``.

    That of the file that ``other_eye`` names, else one at the distance ``eyes``.  Raises SettingsError.
    """
    metrics, sequence = settings.metrics, settings.sequence
    if metrics.other_eye is None:
        to_units = metrics.unit_scale if metrics.eye == "left" else -metrics.unit_scale
        convergence = None if metrics.convergence is None else metrics.convergence * metrics.unit_scale
        return EyeCamera(camera, metrics.eyes * to_units, convergence)
    if isinstance(camera, RecordedCamera):
        what = "the other eye is a camera of the scene, which does not follow the recorded one"
        raise SettingsError(what, hint="leave --other-eye out: the other eye is at --eyes", setting="other_eye")
    other = choose_camera(scene, metrics.other_eye, (sequence.width, sequence.height))
    if isinstance(other, FileCamera) and isinstance(camera, FileCamera) and other.node == camera.node:
        what = f"the other eye is {other.describe()}, which is the camera"
        raise SettingsError(what, hint="give another --other-eye or --camera", setting="other_eye")
    return other


def both_eyes(scene: Scene, camera: CameraTrack, settings: Settings) -> dict[str, tuple[CameraTrack, Settings]]:
    """``left`` and ``right`` -> that eye as the camera, and the settings with which the other eye is its history."""
    metrics, other = settings.metrics, other_eye(scene, camera, settings)
    back: dict[str, object] = {"eye": "right" if metrics.eye == "left" else "left"}
    if metrics.other_eye is not None:
        back["other_eye"] = list(scene.camera_nodes).index(camera.node) if isinstance(camera, FileCamera) else ORBIT
    eyes = {metrics.eye: (camera, settings), back["eye"]: (other, settings.replace(**back))}
    return {name: eyes[name] for name in EYES}
