"""The underlay's tf_transformations has the conventions of the package it stands in for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

import tf_transformations as tft

ANGLES = st.floats(-1.4, 1.4)


def same_rotation(a, b):
    return min(np.abs(a - b).max(), np.abs(a + b).max()) < 1e-9


@given(ANGLES, ANGLES, ANGLES)
def test_euler_angles_are_static_xyz_and_quaternions_xyzw(roll, pitch, yaw):
    quaternion = tft.quaternion_from_euler(roll, pitch, yaw)
    assert same_rotation(quaternion, Rotation.from_euler("xyz", [roll, pitch, yaw]).as_quat())
    assert np.allclose(tft.euler_from_quaternion(quaternion), [roll, pitch, yaw])
    assert np.allclose(tft.euler_matrix(roll, pitch, yaw), tft.quaternion_matrix(quaternion))
    assert np.allclose(tft.euler_from_matrix(tft.quaternion_matrix(quaternion)), [roll, pitch, yaw])


def test_known_values():
    half = math.sqrt(0.5)
    assert np.allclose(tft.quaternion_from_euler(0, 0, math.pi / 2), [0, 0, half, half])
    assert np.allclose(tft.quaternion_about_axis(math.pi / 2, (0, 2, 0)), [0, half, 0, half])
    assert np.allclose(tft.quaternion_from_matrix(np.identity(4)), [0, 0, 0, 1])
    assert np.allclose(tft.quaternion_inverse([1, 2, 3, 4]), np.array([-1, -2, -3, 4]) / 30)
    assert np.allclose(tft.quaternion_conjugate([1, 2, 3, 4]), [-1, -2, -3, 4])


@given(ANGLES, ANGLES, ANGLES)
def test_products_apply_the_right_factor_first(a, b, c):
    q1, q0 = tft.quaternion_from_euler(a, b, c), tft.quaternion_from_euler(c, a, b)
    product = tft.quaternion_multiply(q1, q0)
    assert same_rotation(product, (Rotation.from_quat(q1) * Rotation.from_quat(q0)).as_quat())
    matrices = tft.concatenate_matrices(tft.quaternion_matrix(q1), tft.quaternion_matrix(q0))
    assert np.allclose(matrices, tft.quaternion_matrix(product))
    assert same_rotation(tft.quaternion_from_matrix(matrices), product)


@given(ANGLES, ANGLES, st.floats(0, 1), st.booleans())
def test_slerp_takes_the_short_way(a, b, fraction, flipped):
    start, end = tft.quaternion_from_euler(a, b, 0.3), tft.quaternion_from_euler(b, 0.1, a)
    wanted = Slerp([0, 1], Rotation.from_quat([start, end]))(fraction).as_quat()
    found = tft.quaternion_slerp(start, -end if flipped else end, fraction)
    assert same_rotation(found, wanted) or np.allclose(found, wanted, atol=1e-6)


def test_slerp_the_long_way_when_asked():
    start, end = tft.quaternion_about_axis(0, (0, 0, 1)), tft.quaternion_about_axis(1, (0, 0, 1))
    middle = tft.quaternion_slerp(start, -end, 0.5, shortestpath=False)
    expected = tft.quaternion_about_axis(0.5 - math.pi, (0, 0, 1))
    assert same_rotation(middle, expected)


def test_matrices():
    shift = tft.translation_matrix((1, 2, 3))
    assert np.array_equal(tft.translation_from_matrix(shift), [1, 2, 3])
    assert np.array_equal(tft.identity_matrix(), np.eye(4))
    assert np.allclose(tft.inverse_matrix(shift) @ shift, np.eye(4))
    turn = tft.rotation_matrix(math.pi / 2, (0, 0, 5), point=(1, 0, 0))
    assert np.allclose(turn @ [1, 0, 0, 1], [1, 0, 0, 1])
    assert np.allclose(turn @ [2, 0, 0, 1], [1, 1, 0, 1])


def test_unit_vector_and_norm():
    rows = np.array([[3.0, 4.0], [0.0, 2.0]])
    assert np.allclose(tft.unit_vector(rows, axis=1), [[0.6, 0.8], [0, 1]])
    assert np.allclose(tft.unit_vector([0, 0, 9]), [0, 0, 1])
    out = np.empty((2, 2))
    assert tft.unit_vector(rows, axis=1, out=out) is out
    assert tft.vector_norm([3, 4]) == pytest.approx(5)
    assert np.allclose(tft.vector_norm(rows, axis=1), [5, 2])
