"""The benchmark of marker takes, on a short shipped clip in a known suit and on a file that is none."""

import cv2
import pytest
from bench.marker_takes import marker_takes
from bench.run import Run
from perfanim.core.body.motion import sliced
from perfanim.core.errors import FormatError
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers


@pytest.mark.long
def test_takes_are_solved_or_refused_and_drawn(embedded_motion, tmp_path):
    folder = tmp_path / "data" / "trc"
    folder.mkdir(parents=True)
    worn = load_marker_set("plug-in-gait")
    write_take(simulate_markers(sliced(embedded_motion["walking-02-energetic"], 10, 50), worn)[0], folder / "walk.trc")
    (folder / "page.trc").write_text("<html></html>")
    refused, solved = marker_takes(Run(tmp_path / "data", tmp_path / "out", 1), frames=24)["rows"]
    assert (refused["take"], refused["verdict"]) == ("trc/page.trc", "")
    assert "web page" in refused["refusal"]
    assert (solved["set"], solved["known"], solved["placed"], solved["left_out"]) == ("plug-in-gait", len(worn), 0, 0)
    assert (solved["refusal"], solved["frames"]) == ("", 40)
    assert max(solved[limb] for limb in ("torso", "left arm", "right foot")) < 20.0
    picture = cv2.imread(str(tmp_path / "out" / "pictures" / "trc_walk.trc.png"))
    assert picture.std() > 5.0
    assert picture.shape[1] == 6 * 200


def test_a_folder_without_marker_takes_is_told(tmp_path):
    with pytest.raises(FormatError, match="holds no marker takes"):
        marker_takes(Run(tmp_path, tmp_path / "out"))
