"""Motion and markers for the simulated studio's tests."""

import numpy as np
import pytest
from perfanim.core.body.motion import Motion
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.studio.filmed_motion import Performance, make_performance

FPS = 60.0


class Scene:
    """What stands before the cameras in these tests."""

    fps = FPS

    @staticmethod
    def swinging(frames: int = 60, turn: float = 0.0) -> Motion:
        """A person on the spot whose arms swing; `turn` radians to the left from the cameras."""
        skeleton = default_skeleton()
        time = np.arange(frames) / FPS
        vectors = np.zeros((frames, len(skeleton), 3))
        vectors[:, skeleton.index("lhumerus"), 2] = -0.6 + 0.5 * np.sin(6.0 * time)
        vectors[:, skeleton.index("rhumerus"), 2] = 0.6 - 0.5 * np.sin(6.0 * time + 1.0)
        vectors[:, skeleton.index("rfemur"), 0] = -0.3 * np.sin(4.0 * time)
        vectors[:, 0, 1] = turn
        path = np.zeros((frames, 3))
        path[:, 1] = 0.98
        return Motion("swinging", FPS, skeleton, rot.from_rotation_vector(vectors), path)

    @staticmethod
    def performed(motion: Motion, marker_set: str = "boxing") -> Performance:
        markers = load_marker_set(marker_set)
        return make_performance(motion, markers.names, markers.joint_indices(motion.skeleton), markers.offsets_m)


@pytest.fixture(scope="session")
def scene() -> type[Scene]:
    """A person whose arms swing, with markers."""
    return Scene
