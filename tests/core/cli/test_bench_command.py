"""`perfanim bench` where the benchmarks are, and where they are not."""

import pytest
from perfanim.core.cli import bench_command as bench
from perfanim.core.cli.main import build_parser, main


def test_benchmarks_of_a_checkout_are_commands():
    args = build_parser(["bench"]).parse_args(["bench", "table1", "--data", "d", "--out", "o"])
    assert args.bench == "table1"


def test_the_extension_says_where_benchmarks_are(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(bench, "_TOOLS", tmp_path)
    assert main(["bench", "table1", "--data", "d"]) == 1
    assert "source checkout" in capsys.readouterr().err


@pytest.mark.parametrize("argument", ["-h", "--help"])
def test_help_is_there_either_way(monkeypatch, tmp_path, argument):
    monkeypatch.setattr(bench, "_TOOLS", tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["bench", argument])
    assert ended.value.code == 0
