"""Face subsets: which triangles have which material."""

import pytest
from material_text import subsets
from stage_text import scene_of


def test_materials_of_face_subsets(tmp_path):
    """Faces of a subset have its material, all triangles of a quad too; the rest keep the mesh's."""
    scene = scene_of(tmp_path, subsets([0], [2]))
    assert scene.warnings == ()
    (surface,) = scene.surfaces
    assert [each.path for each in surface.subsets] == ["/World/A/F0", "/World/A/F1"]
    assert [material.path for material in surface.materials] == ["/World/M", "/World/N", "/World/N"]
    assert surface.material_of_triangle.tolist() == [1, 1, 0, 2]


def test_face_subsets_that_overlap(tmp_path):
    """The first of two subsets holds a face that is in both."""
    assert scene_of(tmp_path, subsets([1], [1, 2])).surfaces[0].material_of_triangle.tolist() == [0, 0, 1, 2]


def test_a_face_subset_of_faces_that_are_not_there(tmp_path):
    """One line names the subset and the faces there are."""
    line = "/World/A/F0: indices is 1…3; allowed: 0…2, the faces there are"
    with pytest.raises(ValueError, match="allowed") as error:
        scene_of(tmp_path, subsets([1, 3]))
    assert str(error.value).endswith(line)


def test_subsets_of_points_are_left_out(tmp_path):
    """A subset of another element type is named in a warning."""
    scene = scene_of(tmp_path, subsets([1], more="").replace('"face"', '"point"'))
    assert scene.surfaces[0].subsets == ()
    assert scene.warnings == (
        "/World/A/F0: a materialBind subset of anything but faces is not supported; it is left out",
    )
