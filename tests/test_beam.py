"""The panel's finite elements against closed forms, exact polynomials and the exact Euler-Bernoulli cantilever."""

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray

from sffr_gym.config.params import Params
from sffr_gym.physics.beam import Beam, beam, clamped_modes, one_element_beam, shape_functions
from sffr_gym.physics.each_panel import panel_beams

Array = NDArray[np.float64]

MASS, LENGTH, EI, EA = 7.3, 2.9, 41.0, 5.3e4
DENSITY = MASS / LENGTH
NO_CUT = 1.0e12  # rad/s
# (beta L) of the clamped-free beam: cos(beta L) cosh(beta L) = -1.
CANTILEVER = np.array([1.8751040687119611, 4.6940911329741745, 7.8547574382376126])
BENDING = CANTILEVER**2 * np.sqrt(EI / (DENSITY * LENGTH**4))
AXIAL = (2 * np.arange(1, 4) - 1) * np.pi / 2 * np.sqrt(EA / (DENSITY * LENGTH**2))


def panel(elements: int) -> Beam:
    """Return a panel whose numbers are all different."""
    return beam(MASS, LENGTH, EI, EA, elements)


def axial_field(elements: int) -> Array:
    """Return the nodal coordinates of u(x) = x, which the elements hold exactly."""
    q = np.zeros((elements, 3))
    q[:, 0] = nodes(elements)
    return q.ravel()


def bending_field(elements: int, power: int) -> Array:
    """Return the nodal coordinates of w(x) = x^power, which the elements hold exactly up to the cube."""
    q = np.zeros((elements, 3))
    q[:, 1] = nodes(elements) ** power
    q[:, 2] = power * nodes(elements) ** (power - 1)
    return q.ravel()


def nodes(elements: int) -> Array:
    """Return where the nodes are, the root left out."""
    return LENGTH * np.arange(1, elements + 1) / elements


def moment(power: int) -> float:
    """Return the integral of rho a x^power over the panel."""
    return DENSITY * LENGTH ** (power + 1) / (power + 1)


def test_one_element_is_that_of_the_paper() -> None:
    """Every matrix of Eqs. 45 and 47, in closed form; N is what the third column of Eq. 45 turns with the panel."""
    m, L, one = MASS, LENGTH, panel(1)
    M_ff = m * np.array([[1 / 3, 0, 0], [0, 13 / 35, -11 * L / 210], [0, -11 * L / 210, L**2 / 105]])
    K = np.array([[EA / L, 0, 0], [0, 12 * EI / L**3, -6 * EI / L**2], [0, -6 * EI / L**2, 4 * EI / L]])
    N = m * np.array([[0, 0, 0], [7 / 20, 0, 0], [-L / 20, 0, 0]])
    exact = {"rtol": 1e-13, "atol": 1e-13}
    np.testing.assert_allclose(one.M_ff, M_ff, **exact)
    np.testing.assert_allclose(one.K, K, rtol=1e-13, atol=1e-13 * EA)
    np.testing.assert_allclose(one.N, N, **exact)
    np.testing.assert_allclose(one.S_x, [m / 2, 0, 0], **exact)
    np.testing.assert_allclose(one.S_y, [0, m / 2, -m * L / 12], **exact)
    np.testing.assert_allclose(one.c_x, [m * L / 3, 0, 0], **exact)
    np.testing.assert_allclose(one.c_y, [0, 7 * m * L / 20, -m * L**2 / 20], **exact)
    np.testing.assert_allclose(one[:3], [m, m * L / 2, m * L**2 / 3], **exact)


@pytest.mark.parametrize("elements", [1, 2, 5])
def test_integrals_of_polynomials_are_exact(elements: int) -> None:
    """Every mesh holds u = x and w = x^2, x^3: their masses, couplings and strain energies are known."""
    b, u = panel(elements), axial_field(elements)
    assert u @ b.M_ff @ u == pytest.approx(moment(2), rel=1e-12)
    assert u @ b.K @ u == pytest.approx(EA * LENGTH, rel=1e-12)
    assert b.S_x @ u == pytest.approx(moment(1), rel=1e-12)
    assert b.c_x @ u == pytest.approx(moment(2), rel=1e-12)
    assert abs(b.S_y @ u) < 1e-12
    assert abs(b.c_y @ u) < 1e-12
    np.testing.assert_allclose(b.N @ u @ u, 0.0, atol=1e-12)
    for i in (2, 3):
        w = bending_field(elements, i)
        assert b.S_y @ w == pytest.approx(moment(i), rel=1e-12)
        assert b.c_y @ w == pytest.approx(moment(i + 1), rel=1e-12)
        assert w @ b.N @ u == pytest.approx(moment(i + 1), rel=1e-12)  # the gyroscopic one
        assert abs(u @ b.N @ w) < 1e-12
        assert abs(b.S_x @ w) < 1e-12
        assert abs(u @ b.M_ff @ w) < 1e-12
        for j in (2, 3):
            other = bending_field(elements, j)
            assert w @ b.M_ff @ other == pytest.approx(moment(i + j), rel=1e-12)
            curvature = i * (i - 1) * j * (j - 1) / (i + j - 3) * LENGTH ** (i + j - 3)
            assert w @ b.K @ other == pytest.approx(EI * curvature, rel=1e-11)


@pytest.mark.parametrize("coarse", [1, 2, 3])
def test_elements_are_nested(coarse: int) -> None:
    """Twice as many elements that are given the shape of the coarse ones have all their integrals."""
    fine, step = 2 * coarse, LENGTH / coarse
    P = np.zeros((3 * fine, 3 * coarse))
    for element in range(coarse):
        U, W, *_ = shape_functions(0.5, step)
        slope = np.array([0, -1.5 / step, -0.25, 0, 1.5 / step, -0.25])  # dW/dx at mid-length
        middle = np.vstack([U, W, slope])
        near, far = 3 * (element - 1), 3 * element  # columns of the element's nodes; the root has none
        rows = slice(6 * element, 6 * element + 3)
        P[rows, far : far + 3] = middle[:, 3:]
        if element:
            P[rows, near : near + 3] = middle[:, :3]
        P[6 * element + 3 : 6 * element + 6, far : far + 3] = np.eye(3)
    one, two = panel(coarse), panel(fine)
    np.testing.assert_allclose(one[:3], two[:3], rtol=1e-14)
    for name in ("M_ff", "K", "N"):
        matrix = getattr(one, name)
        np.testing.assert_allclose(P.T @ getattr(two, name) @ P, matrix, rtol=1e-11, atol=1e-12 * np.abs(matrix).max())
    for name in ("S_x", "S_y", "c_x", "c_y"):
        np.testing.assert_allclose(P.T @ getattr(two, name), getattr(one, name), rtol=1e-12, atol=1e-12)


def test_shape_functions_interpolate_their_nodes() -> None:
    """At the two nodes U, W and dW/dx are unit vectors, and the derivatives are those of U and W."""
    length, h = 1.7, 1e-4
    for xi, first in ((0.0, 0), (1.0, 3)):
        U, W, *_ = shape_functions(xi, length)
        np.testing.assert_array_equal(U, np.eye(6)[first])
        np.testing.assert_array_equal(W, np.eye(6)[first + 1])
    for xi in (h, 0.3, 1 - h):
        before, (_, Wb, dU, dW, d2W), after = (shape_functions(xi + k * h, length) for k in (-1, 0, 1))
        (Ua, Wa), (Uc, Wc) = before[:2], after[:2]
        np.testing.assert_allclose((Uc - Ua) / (2 * h * length), dU, atol=1e-11)
        np.testing.assert_allclose((Wc - Wa) / (2 * h * length), dW, atol=1e-7)
        np.testing.assert_allclose((Wa - 2 * Wb + Wc) / (h * length) ** 2, d2W, atol=1e-6)  # rounding: 1e-16 / h^2
    for xi, column in ((0.0, 2), (1.0, 5)):  # the slope coordinates are the slopes at the ends, of a cubic by 3 points
        W = [shape_functions(abs(xi - k * h), length)[1] for k in range(4)]
        slope = (-11 * W[0] + 18 * W[1] - 9 * W[2] + 2 * W[3]) / (6 * h * length) * (1 if xi == 0 else -1)
        np.testing.assert_allclose(slope, np.eye(6)[column], atol=1e-11)


def test_one_element_overestimates_the_frequencies_by_the_known_amount() -> None:
    """The roots of the 2 x 2 determinant; +0.48 % on the first bending mode, +10.3 % on the axial one."""
    modes = clamped_modes(panel(1), NO_CUT, NO_CUT)
    # det (K - omega^2 M_ff) of bending as a polynomial in z = omega^2 rho a L^4 / EI.
    determinant = np.polysub(np.polymul([-13 / 35, 12], [-1 / 105, 4]), np.polymul([11 / 210, -6], [11 / 210, -6]))
    z = np.sort(np.roots(determinant))
    assert modes.n_axial == 1
    np.testing.assert_allclose(modes.omega[1:], np.sqrt(z * EI / (DENSITY * LENGTH**4)), rtol=1e-9)
    np.testing.assert_allclose(modes.omega[0], np.sqrt(3 * EA / (DENSITY * LENGTH**2)), rtol=1e-12)
    assert modes.omega[1] / BENDING[0] - 1 == pytest.approx(0.0048, abs=5e-5)  # the digits given
    assert modes.omega[0] / AXIAL[0] - 1 == pytest.approx(0.103, abs=5e-4)


def test_frequencies_converge_to_the_exact_beam() -> None:
    """From above, with order 4 (cubic bending) and 2 (linear axial), the first two modes of each family."""
    counts = np.array([4, 8, 16])
    errors = []
    for elements in counts:
        modes = clamped_modes(panel(int(elements)), NO_CUT, NO_CUT)
        axial, bending = modes.omega[: modes.n_axial], modes.omega[modes.n_axial :]
        errors.append(np.concatenate([axial[:2] / AXIAL[:2], bending[:2] / BENDING[:2]]) - 1)
    errors = np.array(errors)
    assert (errors > 0).all()
    slopes = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    np.testing.assert_allclose(slopes, [-2, -2, -4, -4], atol=0.1)
    assert errors[-1].max() < 1e-2
    assert errors[-1, 2:].max() < 1e-5


@pytest.mark.parametrize("elements", [1, 2, 6])
def test_modes_diagonalise_the_panel(elements: int) -> None:
    """Mass-normalised, axial ones first, each family in ascending order, uncoupled, positive at the tip."""
    b = panel(elements)
    omega, n_axial, shapes = clamped_modes(b, NO_CUT, NO_CUT)
    assert shapes.shape == (3 * elements, 3 * elements)
    assert n_axial == elements
    np.testing.assert_allclose(shapes.T @ b.M_ff @ shapes, np.eye(3 * elements), atol=1e-10)
    K = shapes.T @ b.K @ shapes
    np.testing.assert_allclose(K, np.diag(omega**2), rtol=1e-10, atol=1e-10 * omega.max() ** 2)
    assert (np.diff(omega[:n_axial]) > 0).all()
    assert (np.diff(omega[n_axial:]) > 0).all()
    reference = np.sqrt(scipy.linalg.eigh(b.K, b.M_ff, eigvals_only=True))
    np.testing.assert_allclose(np.sort(omega), reference, rtol=1e-9)
    is_axial = np.arange(3 * elements) % 3 == 0
    assert not shapes[np.ix_(~is_axial, np.arange(n_axial))].any()
    assert not shapes[np.ix_(is_axial, np.arange(n_axial, 3 * elements))].any()
    assert (shapes[-3, :n_axial] > 0).all()
    assert (shapes[-2, n_axial:] > 0).all()


def test_cuts_leave_out_what_lies_above() -> None:
    """Each family's kept modes are those of the whole set up to its cut, the cut included; nothing is too low a cut."""
    b = panel(4)
    whole = clamped_modes(b, NO_CUT, NO_CUT)
    is_axial = np.arange(len(whole.omega)) < whole.n_axial
    for axial, bending in ((AXIAL[0] * 1.2, whole.omega[5]), (NO_CUT, BENDING[0] * 1.5), (whole.omega[2], NO_CUT)):
        kept = clamped_modes(b, axial, bending)
        expected = whole.omega <= np.where(is_axial, axial, bending)
        np.testing.assert_allclose(kept.omega, whole.omega[expected], rtol=1e-12)
        np.testing.assert_allclose(kept.shapes, whole.shapes[:, expected], rtol=1e-9, atol=1e-9)
        assert kept.n_axial == np.count_nonzero(expected[: whole.n_axial])
    assert clamped_modes(b, AXIAL[0] / 2, NO_CUT).n_axial == 0
    empty = clamped_modes(b, AXIAL[0] / 2, BENDING[0] / 2)
    assert (empty.omega.shape, empty.shapes.shape, empty.n_axial) == ((0,), (12, 0), 0)


def test_one_element_of_a_panel_does_not_depend_on_its_elements(params: Params) -> None:
    """It is the configured panel's beam where that has one element, and stays the same where it has more."""
    one = one_element_beam(params.panel)
    many = params.with_overrides("panel.elements=4")
    for ours, configured, finer in zip(one, panel_beams(params)[0], one_element_beam(many.panel), strict=True):
        np.testing.assert_array_equal(ours, configured)
        np.testing.assert_array_equal(ours, finer)
