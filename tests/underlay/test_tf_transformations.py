"""The underlay's tf_transformations has the conventions of the package it stands in for."""

import math

import numpy as np
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


@given(ANGLES, ANGLES, ANGLES)
def test_products_apply_the_right_factor_first(a, b, c):
    q1, q0 = tft.quaternion_from_euler(a, b, c), tft.quaternion_from_euler(c, a, b)
    product = tft.quaternion_multiply(q1, q0)
    assert same_rotation(product, (Rotation.from_quat(q1) * Rotation.from_quat(q0)).as_quat())
    matrices = tft.concatenate_matrices(tft.quaternion_matrix(q1), tft.quaternion_matrix(q0))
    assert np.allclose(matrices, tft.quaternion_matrix(product))
    assert same_rotation(tft.quaternion_from_matrix(matrices), product)


@given(ANGLES, ANGLES, st.floats(0, 1), st.booleans())
def test_slerp_takes_the_shorter_path(a, b, fraction, flipped):
    start, end = tft.quaternion_from_euler(a, b, 0.3), tft.quaternion_from_euler(b, 0.1, a)
    wanted = Slerp([0, 1], Rotation.from_quat([start, end]))(fraction).as_quat()
    found = tft.quaternion_slerp(start, -end if flipped else end, fraction)
    assert same_rotation(found, wanted) or np.allclose(found, wanted, atol=1e-6)


def test_translations_and_inverses():
    shift = tft.translation_matrix((1, 2, 3))
    assert np.array_equal(tft.translation_from_matrix(shift), [1, 2, 3])
    assert np.allclose(tft.inverse_matrix(shift) @ shift, np.eye(4))
