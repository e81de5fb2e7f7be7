"""What a plan says about each take."""

import pytest
from perfanim.core.cli.batch.plan import plan_of, read_plan
from perfanim.core.errors import SettingsError


@pytest.fixture
def plan(tmp_path):
    """plan(text, **given) -> the plan of a file in a folder with some takes."""
    for name in ("day1/walk.c3d", "day1/run.c3d", "day2/walk.trc", "day2/notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    for name in ("own.toml", "other.toml", "rig.toml"):
        (tmp_path / name).touch()

    def read(text, **given):
        (tmp_path / "plan.toml").write_text(text)
        return read_plan(tmp_path / "plan.toml", given)

    return read


def test_what_takes_share_and_what_they_have_of_their_own(plan, tmp_path):
    read = plan(
        """
        out = "results"
        database = "all.pfdb"
        subject = "own.toml"
        marker_set = "boxing"
        smooth = 6
        names = "names.toml"
        use = "9"
        [[take]]
        take = "day1/*.c3d"
        [[take]]
        take = "day2"
        skeleton = "person.asf"
        marker_set = "other.toml"
        to = "hero.glb"
        root_motion = "object"
        """,
        smooth=8.0,
    )
    assert read.out == str(tmp_path / "results")
    day1, day2, run = read.takes
    assert [take.source for take in read.takes] == ["day1/walk.c3d", "day2/walk.trc", "day1/run.c3d"]
    assert [take.name for take in read.takes] == ["day1-walk", "day2-walk", "run"]
    assert (run.take, run.is_tracked) == (str(tmp_path / "day1" / "run.c3d"), False)
    assert _pairs(run.options_of("solve")) == {
        "--database": str(tmp_path / "all.pfdb"),
        "--subject": str(tmp_path / "own.toml"),
        "--marker-set": "boxing",
        "--smooth": "8.0",
        "--names": str(tmp_path / "names.toml"),
        "--use": "9",
    }
    assert run.options_of("retarget") == []
    assert day1.options == run.options
    solve = _pairs(day2.options_of("solve"))
    assert "--subject" not in solve  # its own skeleton takes the place of the shared subject
    assert (solve["--skeleton"], solve["--marker-set"]) == (str(tmp_path / "person.asf"), str(tmp_path / "other.toml"))
    assert _pairs(day2.options_of("retarget")) == {"--to": str(tmp_path / "hero.glb"), "--root-motion": "object"}


def test_videos_are_tracked(plan, tmp_path):
    (take,) = plan("""
        database = "all.pfdb"
        cameras = "rig.toml"
        marker_set = "boxing"
        [[take]]
        left = "wave-left.mp4"
        camera = ["middle=wave-middle.mp4", "right/*.png"]
        no_time_offset = true
        background = ["empty-left.mp4", "empty-right.mp4"]
        """).takes
    assert (take.name, take.take, take.is_tracked) == ("wave-left", "", True)
    assert take.options_of("track") == [
        *("--cameras", str(tmp_path / "rig.toml"), "--marker-set", "boxing"),
        *("--left", str(tmp_path / "wave-left.mp4")),
        *("--camera", f"middle={tmp_path / 'wave-middle.mp4'}", "--camera", str(tmp_path / "right" / "*.png")),
        *("--no-time-offset", "--background", str(tmp_path / "empty-left.mp4"), str(tmp_path / "empty-right.mp4")),
    ]
    assert "--cameras" not in take.options_of("solve")


def test_what_is_shared_is_asked_of_none_that_has_no_use_for_it(plan, tmp_path):
    shared = 'cameras = "rig.toml"\nup = "z"\nuse = "9"\nnames = "n.toml"\n'
    text = f'{shared}[[take]]\ntake = "night.perftake"\n[[take]]\ntake = "walk.c3d"'
    recorded, markers = plan(text).takes
    assert recorded.options_of("solve") == ["--cameras", str(tmp_path / "rig.toml")]
    assert _pairs(markers.options_of("solve")) == {"--up": "z", "--use": "9", "--names": str(tmp_path / "n.toml")}


def test_names_depend_on_no_order(plan, tmp_path):
    sources = ["day1/walk.c3d", "day2/walk.trc", "day1/run.c3d"]
    for order in (sources, sources[::-1]):
        takes = plan("".join(f'[[take]]\ntake = "{source}"\n' for source in order)).takes
        assert {take.name: take.source for take in takes} == {
            "day1-walk": "day1/walk.c3d",
            "day2-walk": "day2/walk.trc",
            "run": "day1/run.c3d",
        }
    (tmp_path / "day1" / "walk.trc").touch()
    takes = plan('[[take]]\ntake = "day1/walk.*"\n[[take]]\ntake = "day1/run.c3d"\nname = "Race 1"').takes
    assert [take.name for take in takes] == ["Race 1", "day1-walk.c3d", "day1-walk.trc"]


def test_takes_of_the_command_line(plan, tmp_path, monkeypatch):
    plan('[[take]]\ntake = "day1"')
    monkeypatch.chdir(tmp_path)
    takes = plan_of(["day1", "day2/*.trc", "none.c3d"], {"database": "all.pfdb"}).takes
    assert [take.source for take in takes] == ["day1/walk.c3d", "day2/walk.trc", "none.c3d", "day1/run.c3d"]
    assert takes[0].options == {"database": str(tmp_path / "all.pfdb")}


@pytest.mark.parametrize("out", [".", "solved", "a/b"])
def test_results_among_or_below_the_takes_are_no_takes(tmp_path, monkeypatch, out):
    monkeypatch.chdir(tmp_path)
    place = tmp_path / "takes" / out
    (place / "report").mkdir(parents=True)
    (tmp_path / "takes" / "walk.trc").touch()
    for name in ("film.take.npz", "summary.csv", "film.angles.csv", "film.bvh"):
        (place / name).touch()
    (place / "report" / "film.json").write_text('{"outputs": {"take": "film.take.npz"}}')
    (place / "report" / "other.json").write_text("[3]")
    for source in ("takes", "takes/**/*.*z", "takes/**/*.trc"):
        if source.endswith("z"):
            with pytest.raises(SettingsError, match="there are no takes"):
                plan_of([source], {})
        else:
            assert [take.source for take in plan_of([source], {}).takes] == ["takes/walk.trc"]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ('database = "a"', r"lacks 'take', a list of tables \[\[take\]\]; add"),
        ("take = []", "names no takes"),
        ("take = 3", r"take must be a list of tables \[\[take\]\]"),
        ("[[take]]\ntake = 3", "take 1: take must be a string"),
        ('[[take]]\ntake = "day1"\ntempo = 3', "has an unknown key 'tempo'"),
        ('method = 3\n[[take]]\ntake = "day1"', "method must be a non-empty string"),
        ('smooth = "6"\n[[take]]\ntake = "day1"', "smooth must be a number from 0 to 1,000,000 Hz"),
        ('rate = -1\n[[take]]\ntake = "day1"', "rate must be a number from 0 to 1,000,000 frames per second"),
        ('background = "x.mp4"\n[[take]]\ntake = "day1"', "background must be a list of non-empty strings"),
        ('no_time_offset = 1\n[[take]]\ntake = "day1"', "no_time_offset must be true or false"),
        ('also = ["bvh"]\n[[take]]\ntake = "day1"', "also must be a list of strings out of angles.csv, vrma"),
        ('also = [["vrma"]]\n[[take]]\ntake = "day1"', "also must be a list of strings out of angles.csv, vrma"),
        ('also = "vrma"\n[[take]]\ntake = "day1"', "also must be a list of strings out of angles.csv, vrma"),
        ('save_as = "obj"\n[[take]]\ntake = "day1"', "save_as must be one of blend, fbx, glb"),
        ('[[take]]\ntake = "day3/*.c3d"', "there are no takes"),
        ('[[take]]\ntake = "day1"\nname = "walk"', "the name 'walk' is given to 2 takes"),
        ('[[take]]\ntake = "day1/run.c3d"\nname = "../run"', "cannot be the name of a file"),
        ('[[take]]\ntake = "day1/run.c3d"\nname = "X"\n[[take]]\ntake = "day2/walk.trc"\nname = "x"', "both be called"),
        ('[[take]]\ntake = "day1/run.c3d"\n[[take]]\ntake = "day1/run.c3d"', "both be called"),
        ('[[take]]\nsubject = "own.toml"', "names neither a take nor videos"),
        ('cameras = "rig.toml"\n[[take]]\ncamera = []', "names neither a take nor videos"),
        ('[[take]]\nleft = "a.mp4"\nright = "b.mp4"', "has videos but no calibration"),
        ('out = 3\n[[take]]\ntake = "day1"', "out must be a string"),
    ],
)
def test_what_cannot_be_meant(plan, text, what):
    with pytest.raises(SettingsError, match=what):
        plan(text)


@pytest.mark.parametrize("take", ["day1", "*", "**/*.c3d"])
def test_a_folder_of_more_files_than_takes_can_be(plan, monkeypatch, take):
    monkeypatch.setattr("perfanim.core.cli.batch.plan._MOST_FILES", 1)
    with pytest.raises(SettingsError, match="holds more than 1 files"):
        plan(f'[[take]]\ntake = "{take}"')


def _pairs(options):
    return dict(zip(options[::2], options[1::2], strict=True))


def test_the_starter_database_has_a_name(tmp_path, monkeypatch):
    (tmp_path / "a.trc").write_text("x")
    monkeypatch.setattr("perfanim.core.cli.batch.plan.starter_database", lambda: tmp_path / "cache.pfdb")
    (take,) = plan_of([str(tmp_path / "a.trc")], {"database": "starter"}).takes
    assert take.options["database"] == str(tmp_path / "cache.pfdb")
