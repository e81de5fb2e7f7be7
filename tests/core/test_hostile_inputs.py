"""Hostile and damaged files of every kind: refused at once, in one line of our own, within bounded memory."""

import os
import re
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from perfanim.core.cli.batch.plan import read_plan
from perfanim.core.database.store import open_database
from perfanim.core.errors import MOST_TEXT, PerfanimError
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.asf import read_asf
from perfanim.core.formats.motion.motion_sources import motion_files
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.take_file.chunks import preamble
from perfanim.core.formats.take_file.take_reader import has_frames, read_take_file, summarise
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.markers.label_matching import load_names
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.prop import load_prop
from perfanim.core.markers.subject import load_subject
from perfanim.core.retarget.bone_map_files import load_bone_map, read_bone_map
from perfanim.core.sketch.sketch_file import read_sketch
from perfanim.core.system.files import read_toml
from perfanim.core.vision.calibration.board_points import load_board_points
from perfanim.core.vision.sources.image_files import read_image
from perfanim.core.vision.sources.source_kinds import open_image_source
from small_files import AMC, ASF, BVH, MOTIVE, QUALISYS, TRC

Reader = Callable[[Path], object]


def list_motion(path: Path) -> None:
    with motion_files([path]):
        pass


# readers by file name; a name alone tells the kind of file
READERS: dict[str, tuple[Reader, ...]] = {
    "a.perftake": (read_take_file, summarise, has_frames),
    "a.toml": (read_toml, load_names),
    "rig.toml": (load_rig,),
    "subject.toml": (load_subject,),
    "set.toml": (load_marker_set,),
    "prop.toml": (load_prop,),
    "map.toml": (read_bone_map, lambda path: load_bone_map(str(path))),
    "plan.toml": (lambda path: read_plan(path, {}),),
    "rig.txt": (load_rig,),
    "a.bvh": (read_motion,),
    "a.amc": (lambda path: read_motion(path, path.with_name("skeleton.asf")),),
    "a.asf": (read_asf,),
    "a.zip": (list_motion,),
    "a.pfdb": (open_database,),
    "a.c3d": (read_take,),
    "a.trc": (read_take,),
    "a.csv": (read_take,),
    "a.tsv": (read_take,),
    "a.take.npz": (read_take,),
    "a.xyz": (read_take,),
    "sketch.csv": (read_sketch,),
    "points.json": (load_board_points,),
    "a.png": (read_image,),
    "source.png": (open_image_source,),
    "a.mp4": (open_image_source,),
}
TOML = [read for name, readers in READERS.items() if name.endswith(".toml") for read in readers]

MARKER = '[[marker]]\nname = "A"\njoint = "root"\n'
SUBJECT = 'kind = "perfanim subject"\nversion = 1\nname = "a"\nresidual_m = 0.0\n'
JOINT = """[[joint]]
name = "root"
parent = ""
offset_m = [0, 1, 0]
tip_m = [0, 0, 0]
angle_axes = [1, 0, 0, 0]
angle_order = "ZYX"
"""
PROP = 'kind = "perfanim prop"\nversion = 1\nname = "x"\n'
SIZED = "[cam_0]\nsize = [4, 4]\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
PLACED = "rotation = [0, 0, 0]\ntranslation = [0, 0, 0]\n"
SKETCH = "# fps=30\ncontrol,frame,x,y,z\n"
BAD_TOML = r"is not valid TOML"

# file name -> content and the sentence, a regular expression, that tells what is wrong
CASES: dict[str, list[tuple[str | bytes, str]]] = {
    "a.bvh": [
        ("", "does not begin with HIERARCHY"),
        (bytes(range(256)) * 30, "does not begin with HIERARCHY"),
        (BVH[: BVH.index("JOINT Slider")], "no MOTION section"),
        (BVH.replace("}\nMOTION", "MOTION"), "incomplete hierarchy"),
        (BVH.replace("MOTION\n", "}\nMOTION\n"), "closes more joints"),
        (BVH.replace("0.1 -0.5 0", "0.1 x 0"), "line 8: has an OFFSET that is not a number"),
        (BVH.replace("CHANNELS 3", "CHANNELS 4"), "line 9: has unknown channels"),
        (BVH.replace("Yrotation Xrotation Zrotation", "Wrotation Xrotation Zrotation"), "unknown channels"),
        (BVH.replace("Frames: 2\n", ""), "line 25: needs 'Frames:'"),
        (BVH[: BVH.rindex("4 5 6")], "line 29: has 12 of 15 values"),
        (BVH.replace("1 2 3\n1 2 4", "1 2 3 7\n1 2 4"), "line 28: has 16 of 15 values; write one frame per line"),
        (BVH.replace("0 1 2 3\n1 2 4", "0 1 2\n1 2 4"), "line 28: has 14 of 15 values; write one frame per line"),
        (BVH.replace("Frames: 2", "Frames: 9").replace("1 2 3\n", "1 2 3 7 8\n") + "1 2 3", "line 28: has 17 of 15"),
        (BVH.replace("4 5 6", "4 5 6 7"), "line 29: has 16 of 15 values"),
        (BVH.replace("1 2 4 11", "1 2 4 1,1"), "'1,1' is not a finite number; write all numbers with decimal points"),
        (BVH.replace("1 2 4 11", "1 2 4 abc"), "line 29: 'abc' is not a finite number"),
        (BVH.replace("1 2 4 11", "1 2 4 inf"), "line 29: 'inf' is not a finite number"),
        (BVH.replace("1 2 4 11", "1" * 200_000 + "x"), "is not a finite number"),
        (BVH[: BVH.index("1 2 3 10")], "no frames"),
        (BVH.replace("ROOT mixamorig:Hips", "End Site"), "line 2: has an end site outside of a joint"),
        (BVH.replace("JOINT Slider", "BONE Slider"), "line 15: has the unknown keyword 'BONE'"),
        *(
            (BVH.replace("Frame Time: 0.0333333", f"Frame Time: {rate}"), "a 'Frame Time:' from")
            for rate in ("1e-300", "1e300", "inf", "nan", "0", "1e-9", "9" * 5000)
        ),
    ],
    "a.amc": [
        ("", "is not an AMC motion"),
        ("\x00\x01binary", "is not an AMC motion"),
        (AMC.replace("lfemur", "lthigh"), "a.amc, line 6: moves the bone 'lthigh'"),
        (AMC.replace("ltibia 40", "ltibia 40 3"), "a.amc, line 7: has 2 values for 'ltibia'"),
        (AMC.replace("ltibia 41", "ltibia x"), "a.amc, line 11: 'x' is not a number"),
        (AMC.replace("ltibia 41", "ltibia inf"), "a.amc, line 11: has a value of 'ltibia' that is not finite"),
        (AMC.replace("ltibia 41", "ltibia"), "a.amc, line 11: expected 1 values of 'ltibia', found 0"),
        (AMC.replace("lfemur 5 15 25\nltibia 41", "lfemurs 5 15 25\nltibia 41"), "line 10: expected the values of"),
        (AMC.replace("lfemur 5 15 25\nltibia 41", "ltibia 41"), "a.amc, line 10: expected the values of 'lfemur'"),
        (AMC[: AMC.rindex("ltibia")], "ends within a frame"),
        (AMC.replace("\n2\n", "\n3\n"), "out of sequence"),
        (AMC.replace("root 1 2 3 10 20 30\n", ""), "no root"),
    ],
    "a.asf": [
        ("", "is not an ASF skeleton"),
        (ASF.replace("length 10", "length ten"), "is damaged"),
        (ASF.replace("direction 0 -1 0", "direction 0 -1"), "line 23: needs 3 numbers, has 2"),
        (ASF.replace("lfemur ltibia", "lfemur shin"), "unknown bone 'shin'"),
        (ASF.replace("root lhipjoint", "root"), "not connected to the root"),
        (ASF.replace("dof rx\n", "dof rq\n"), "unknown or repeated degrees of freedom"),
        (ASF.replace("length 0.5", "length 0"), "has a length unit of 0"),
        (ASF[: ASF.index(":hierarchy")], "has no :hierarchy section"),
        (ASF.replace("0 0 30 XYZ", "0 0 30 XXZ", 1), "unknown axis order"),
    ],
    "a.trc": [
        ("", "is not a TRC file"),
        (TRC[:90], "ends within its header"),
        (TRC.replace("2.1e1", "x"), "line 8: has a field that is not a number"),
        (TRC.replace("\tcm\t", "\tfurlong\t"), "unknown unit of length 'furlong'"),
        (TRC.replace("A\t\t\tB", "\t\t\t"), "has no markers"),
        (TRC.replace("3\t2\tcm", "3\t1\tcm"), "declares 1 markers but names 2"),
        (TRC.replace("12\t22\t32\t1\t2\t3", "12\t22\t32\t1\t2\t3\t4"), "line 9: has more than"),
        (TRC[: TRC.index("1\t0.00")], "has no frames"),
    ],
    "a.csv": [
        ("", "is empty"),
        ("time,speed\n1,2\n", "is not a marker take"),
        ("frame,time_s,A_x,A_y,A_z\n1,0,1,2,q\n", "line 2: has a field that is not a number"),
        ("frame,A_x,A_y,A_z\n1,1,2,3\n", "neither fps nor times"),
        ("frame,time_s,A_x,A_y,A_z\n1,0,1,2,3,4\n", "line 2: has more than 5 fields"),
        (MOTIVE[: MOTIVE.index("0,0.0")], "has no frames"),
        (MOTIVE.replace("Marker", "Camera"), "has no markers"),
    ],
    "a.tsv": [
        ("frame\tspeed\n1\t2\n", "is not a Qualisys marker export"),
        (QUALISYS, "has no frames"),
        (QUALISYS + "1\t2\t3\t4\t5\n", "line 11: has 5 fields, not 6"),
        (QUALISYS + "1\t2\t3\t4\t5\t6\n1\t2\tx\t4\t5\t6\n", "line 12: has a field that is not a number"),
        (QUALISYS.replace("\t3D", "\t6D") + "1\t2\t3\t4\t5\t6\n", "holds no 3D data"),
        (QUALISYS.replace("\tHead", "") + "1\t2\t3\n", "declares 2 markers but names 1"),
        (QUALISYS.replace("\t200\n", "\t0\n") + "1\t2\t3\t4\t5\t6\n", "states neither a frame rate nor times"),
    ],
    "a.c3d": [
        ("", "is empty"),
        ("x" * 3000, "is not a C3D file"),
        ("\x02P" + "\0" * 700, "is cut off within its header"),
    ],
    "a.xyz": [("x", "is not a marker take")],
    "a.take.npz": [("junk", "is not a marker take")],
    "a.pfdb": [
        ("junk\n" * 50, "is not a motion database"),
        ("HIERARCHY\n" * 50, "is a BVH file, not the expected motion database"),
    ],
    "a.perftake": [
        ("", "is empty"),
        ("no take at all, but some words", "is not a recorded take"),
        (bytes(range(1, 256)) * 20, "is not a recorded take"),
        (preamble()[:7], "cut off before anything was recorded"),
    ],
    "a.png": [
        (data, "is not a readable image")
        for data in (b"", b"\xff\xd8", b"P6 \n", b"GIF89a" + bytes(99), b"\xff\xd8" + b"\xff\xd0" * 999)
    ],
    "points.json": [
        ("", "points.json"),
        ("not json", "points.json"),
        ('{"image_size": [640, 480]}', "board_points_mm"),
    ],
    "sketch.csv": [
        ("", "is not a sketch"),
        ("frame,time_s,A_x,A_y,A_z\n", "is not a sketch"),
        (SKETCH, "has no keys"),
        *((f"{fps}control,frame,x,y,z\nhead,1,0,1,0\n", "frame rate") for fps in ("", "# fps=abc\n", "# fps=1e9\n")),
        (SKETCH + "tail,1,0,1,0\n", "line 3: there is no joint 'tail'"),
        (SKETCH + "head,1,0,1\n", "line 3: has 4 fields"),
        (SKETCH + "head,1.5,0,1,0\n", "line 3: needs a whole frame number"),
        (SKETCH + "head,1,,1,0\n", "line 3: needs a whole frame number and a finite position"),
        (SKETCH + "head,1,inf,1,0\n", "line 3: needs a whole frame number and a finite position"),
        (SKETCH + "head,1,one,1,0\n", "line 3: has a field that is not a number"),
        (SKETCH + "head,1,5000,1,0\n", "line 3: has a coordinate beyond"),
        (SKETCH + "head,1,0,1,0\nhead,90000,0,1,0\n", "but may span at most 20000 frames"),
        (SKETCH + "head,1,0,1,0\x00\n", "is not a text file"),
    ],
    "set.toml": [
        ("[[", BAD_TOML),
        ("", r"lacks 'marker', a list of tables \[\[marker\]\]"),
        ("marker = []", "needs markers"),
        ("marker = 5", r"marker must be a list of tables \[\[marker\]\]"),
        ("marker = [1, 2]", r"marker must be a list of tables \[\[marker\]\]"),
        (MARKER + "offset_m = [30, 0, 0]", "A: offset_m must be .* from -10 to 10 m"),
        (MARKER + "torso = 1", "A: torso must be true or false"),
        ('[[marker]]\njoint = "root"', "lacks 'name'"),
        ('[[marker]]\nname = "A"', "lacks 'joint'"),
        (MARKER + "offset_m = [1.0]", "A: offset_m must be three numbers"),
        (MARKER + 'offset_m = "abc"', "three numbers"),
        (MARKER * 2, "unique names"),
        (MARKER + "torso = true\n", "at least 3 markers with torso"),
    ],
    "subject.toml": [
        ("", "not a subject file"),
        (SUBJECT.replace("version = 1", "version = 2"), "not a subject file of this version; calibrate"),
        (SUBJECT, r"lacks 'joint', a list of tables \[\[joint\]\]; calibrate the subject again"),
        (SUBJECT + JOINT, r"lacks 'marker_set', a table \[marker_set\]"),
        (SUBJECT + "marker_set = 3\n" + JOINT, r"marker_set must be a table \[marker_set\]"),
        (SUBJECT + "joint = [1]\n[marker_set]\n", "joint must be a list of tables"),
        (SUBJECT + '[[joint]]\nname = "a"\nparent = "b"', "a: lacks 'offset_m', three numbers from -10 to 10 m"),
    ],
    "prop.toml": [
        ("", "prop"),
        (PROP.replace("1", "2"), "version"),
        (PROP, "marker"),
        (PROP + '[[marker]]\nname = "A"\nposition_m = [1, 2]\n' * 3, "position_m must be three numbers"),
    ],
    "map.toml": [
        ("", r"lacks 'joints', a table \[joints\] of names, each with a non-empty string"),
        ('joints = "root"', r"joints must be a table \[joints\] of names"),
        ('[joints]\nroot = ""', r"joints must be a table \[joints\] of names"),
        ('name = 3\n[joints]\nroot = "Hips"', "name must be a string"),
    ],
    "rig.toml": [
        ("", "no cameras"),
        ("cam_0 = 5", ""),
        ('cam_0 = "text"', ""),
        ("[cam_0]\nname = 'a'", "lacks"),
        (SIZED.replace("4, 4", "4") + PLACED, "size must be"),
        (SIZED.replace(", 0]", "]") + PLACED, "matrix must be"),
        (SIZED + PLACED.replace("[0, 0, 0]", "[0, 0]", 1), "rotation must be"),
        (SIZED + PLACED.replace("[0, 0, 0]", "['a']", 1), "rotation must be"),
        (SIZED + PLACED + "fisheye = true", "fisheye"),
        (SIZED + PLACED + "distortions = [0.1, 0, 0, 0, 0, 0.4, 0, 0]", "at most five distortion coefficients"),
        ("metadata = 5\n" + SIZED + PLACED, "metadata"),
        (SIZED + PLACED + "[metadata]\nlength_unit = 'furlong'", "length_unit"),
        ('["cam_²"]\nname = "x"\n["cam_' + "9" * 5000 + '"]\nname = "y"\n', ""),  # digits that are no numbers
    ],
    "rig.txt": [
        ("<calibration><cameras><camera", "not valid XML"),
        ("<html><body/></html>", "is a web page, not the expected calibration"),
        ("<rig/>", r"is another program's XML file \(<rig>\)"),
        ("<calibration><cameras/></calibration>", "holds no cameras"),
        ('<calibration><cameras><camera serial="A1"/></cameras></calibration>', "camera A1: <fov_video> is incomplete"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><calibration/>', "not a Qualisys calibration"),
        ("cameras = 5", "has no camera tables"),
        ("[cameras.1]\nignore = true", "holds no cameras"),
        ('[cameras.1]\nrotation = "null"\ntranslation = "null"', "camera 1 has no rotation"),
        ("[cameras.1]\nrotation = [0, 0, 0]\ntranslation = [0, 0, 0]", "lacks 'size', two whole"),
    ],
}


def refused(read: Reader, path: Path) -> str:
    with pytest.raises(PerfanimError) as caught:
        read(path)
    message = str(caught.value)
    assert len(message) <= MOST_TEXT
    assert "\n" not in message
    message.encode("utf-8")
    return message


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [pytest.param(name, *case, id=f"{name}-{i}") for name, cases in CASES.items() for i, case in enumerate(cases)],
)
def test_damaged_file_is_refused_in_one_line(tmp_path: Path, name: str, content: str | bytes, sentence: str) -> None:
    (tmp_path / "skeleton.asf").write_text(ASF)
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    for read in READERS[name]:
        message = refused(read, tmp_path / name)
        assert re.search(sentence, message), message
        assert name in message or name in ("set.toml", "rig.toml"), message  # these name the set or the camera


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
@pytest.mark.parametrize("name", READERS)
def test_anything_but_a_regular_file_is_refused_without_waiting(name: str, tmp_path: Path) -> None:
    path = tmp_path / name

    def all_refuse() -> None:
        for read in READERS[name]:
            refused(read, path)

    os.mkfifo(path)
    all_refuse()
    path.unlink()
    path.symlink_to("/dev/zero")
    all_refuse()
    path.unlink()
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "s"))
        path.symlink_to(tmp_path / "s")
        all_refuse()
    path.unlink()
    path.mkdir()
    if name != "a.zip":  # a folder of motion is as good as an archive
        all_refuse()


@pytest.mark.parametrize("stem", ["gone-", "a\0b", "\ud800", "\udcff", "x" * 300, "y/" * 3000])
@pytest.mark.parametrize("name", READERS)
def test_missing_file_and_impossible_name_are_refused(name: str, stem: str, tmp_path: Path) -> None:
    for read in READERS[name]:
        refused(read, tmp_path / f"{stem}{name}")


NUMBERS = ("inf", "nan", "9" * 5000, "9" * 400, "1e300")


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 5000 + "]" * 5000,
        "[" + ".".join("a" * 5000) + "]\nb = 1",
        "a = " + "{a = " * 40 + "1" + "}" * 40,
        'take = "a\\u0000b"',
        *(f"[cam_0]\nsize = [{number}, 480]" for number in NUMBERS),
    ],
    ids=["nested", "tables", "inline", "nul", *(f"number {number[:4]} {len(number)}" for number in NUMBERS)],
)
def test_hostile_toml_is_refused_by_every_reader(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text)
    for read in TOML:
        assert refused(read, tmp_path / "a.toml").startswith(f"{tmp_path / 'a.toml'}: {BAD_TOML}")


@pytest.mark.parametrize("key", ["a" * 100_000, "\u00e4" * 9000])
def test_long_keys_and_values_are_shortened(key: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(f'"{key}" = "{key}"\n[joints]\n"{key}" = "{key}"\n[[take]]\ntake = "a"\n')
    for read in TOML:
        if read not in READERS["a.toml"]:
            refused(read, tmp_path / "a.toml")
