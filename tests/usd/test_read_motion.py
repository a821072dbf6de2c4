"""Transforms that change in time: sampled where they are authored, and on every frame where they are not linear."""

import numpy as np
from stage_text import DOMAIN, scene_of, write_stage

from warp_smoke.scene import Scene


def test_linear_motion_is_sampled_where_it_is_authored(tmp_path):
    """A transform that is linear between samples keeps exactly these, and nested still transforms are multiplied in."""
    scene = scene_of(
        tmp_path,
        """def Xform "Group" {
        float3 xformOp:scale = (2, 2, 2)
        token[] xformOpOrder = ["xformOp:scale"]
        def Cube "A" {
            double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 2.5: (3, 0, 0) }
            token[] xformOpOrder = ["xformOp:translate"] } }""",
    )
    transform = scene.surfaces[0].transform
    assert np.array_equal(transform.times, [1, 2.5])
    assert np.array_equal(transform.at(1.75), [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [3, 0, 0, 1]])


def test_other_motion_is_sampled_on_every_frame_too(tmp_path):
    """A turning prim under a sliding group: samples where either has one and on all frames, equal to USD's matrices."""
    path = write_stage(
        tmp_path,
        """def Xform "Group" {
        double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 3.5: (5, 0, 0) }
        token[] xformOpOrder = ["xformOp:translate"]
        def Cube "A" {
            float xformOp:rotateY.timeSamples = { 2: 0, 6: 90 }
            token[] xformOpOrder = ["xformOp:rotateY"] } }""",
    )
    transform = Scene.open(path).surfaces[0].transform
    assert np.array_equal(transform.times, [1, 2, 3, 3.5, 4, 5, 6])
    c = np.sqrt(0.5)
    assert np.allclose(transform.at(4), [[c, 0, -c, 0], [0, 1, 0, 0], [c, 0, c, 0], [5, 0, 0, 1]], atol=1e-7)
    assert np.allclose(transform.at(2)[3], (2, 0, 0, 1))


def test_samples_without_change_are_a_plain_value(tmp_path):
    """Time samples that all say the same make nothing move."""
    scene = scene_of(
        tmp_path,
        """def Cube "A" {
        float xformOp:rotateY.timeSamples = { 1: 30, 4: 30 }
        token[] xformOpOrder = ["xformOp:rotateY"]
        token visibility.timeSamples = { 1: "inherited", 2: "inherited" } }""",
    )
    assert isinstance(scene.surfaces[0].transform, np.ndarray)
    assert scene.surfaces[0].visible is True


def test_reset_xform_stack(tmp_path):
    """A prim that resets its transform stack does not follow its parent."""
    scene = scene_of(
        tmp_path,
        """def Xform "Group" {
        double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 3: (5, 0, 0) }
        token[] xformOpOrder = ["xformOp:translate"]
        def Cube "A" { token[] xformOpOrder = ["!resetXformStack!"] } }""",
    )
    assert np.array_equal(scene.surfaces[0].transform, np.eye(4))


def test_splines_are_sampled_on_every_frame(tmp_path):
    """A transform driven by a spline is sampled at its knots and the whole times between."""
    scene = scene_of(
        tmp_path,
        """def Cube "A" {
        double xformOp:translateX.spline = { bezier, 1: 0; post curve (0, 0), 4: 3; post curve (0, 0) }
        token[] xformOpOrder = ["xformOp:translateX"] }""",
    )
    assert np.array_equal(scene.surfaces[0].transform.times, [1, 2, 3, 4])
    assert np.allclose(scene.surfaces[0].transform.values[[0, 3], 3, 0], [0, 3])


def test_a_domain_stands_still(tmp_path):
    """A domain whose transform changes in time stays where it is at the start, which is said."""
    moving = """double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 2: (0, 4, 0) }
        token[] xformOpOrder = ["xformOp:translate"]"""
    scene = scene_of(tmp_path, DOMAIN % moving)
    assert scene.domains[0].transform[3, 1] == 2.0
    text = "/World/Box: its transform changes in time, which is not supported; it stays as it is at the start"
    assert scene.warnings == (text,)
