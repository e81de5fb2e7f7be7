"""The shipped mesh of the character is made by its generator."""

import numpy as np
from character_mesh.make_character_mesh import write_character
from perfanim.core.system.assets import CHARACTER


def test_shipped_mesh_is_what_the_command_makes(tmp_path):
    write_character(tmp_path / "character.npz")
    with np.load(tmp_path / "character.npz") as made, np.load(CHARACTER) as shipped:
        assert set(made) == set(shipped)
        assert all(made[name].shape == shipped[name].shape for name in made)
        # a step of the file is 0.1 mm; other processors may round a vertex to its neighbour
        assert np.abs(made["vertices"].astype(int) - shipped["vertices"]).max() <= 1
        assert np.abs(made["weights"].astype(int) - shipped["weights"]).max() <= 4
        assert np.array_equal(made["faces"], shipped["faces"])
