"""The points from which shadows are looked up on smooth-shaded meshes (Hanika, *Hacking the Shadow Terminator*, 2021).

Facets lie below the smooth surface that their normals describe: light that the normals face would be blocked by the
facet itself or its neighbours, and entire facets would turn dark at once. Points are therefore lifted from the facet
towards the tangent planes at its corners. Where a mesh is flat or concave they stay in place.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

# Squared difference of unit normals up to which it counts as rounding.
_EQUAL = wp.constant(1.0e-10)


@wp.struct
class Facet:
    """A triangle: its corners and their unit normals."""

    a: wp.vec3
    b: wp.vec3
    c: wp.vec3
    normal_a: wp.vec3
    normal_b: wp.vec3
    normal_c: wp.vec3


@wp.func
def lift_to(p: wp.vec3, corner: wp.vec3, normal: wp.vec3):
    """The offset that lifts a point to a corner's tangent plane: −min(0, (p − v) · n) n."""
    return -wp.min(wp.dot(p - corner, normal), 0.0) * normal


@wp.func
def lifted_point(f: Facet, p: wp.vec3, w: wp.vec3):
    """The point p with weights w, lifted to p + Σᵢ wᵢ lift_to(p, vᵢ, nᵢ); p itself where the normals are equal."""
    turns = wp.length_sq(f.normal_b - f.normal_a) + wp.length_sq(f.normal_c - f.normal_b)
    if turns <= _EQUAL:
        return p
    lift = w[0] * lift_to(p, f.a, f.normal_a) + w[1] * lift_to(p, f.b, f.normal_b)
    return p + lift + w[2] * lift_to(p, f.c, f.normal_c)


@wp.func
def facet_normal(f: Facet, outside: wp.vec3):
    """The triangle's unit normal on the side of `outside`; zero without area."""
    n = wp.normalize(wp.cross(f.b - f.a, f.c - f.a))
    return wp.where(wp.dot(n, outside) < 0.0, -n, n)
