"""Equations of motion of single bodies, derived by SymPy from their energies alone (Euler-Lagrange).

Bodies are the base or the object, the links of an arm, and a Hermite element of a panel; `oracle` adds them up. Each
becomes plain functions of its parameters, coordinates and velocities, and shares no code with the simulator.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import sympy as sp

N_POSE = 3  # x, y, beta
N_NODE = 3  # u, w, slope


class Body(NamedTuple):
    """Functions of one body, each called as f(*parameters, *coordinates, *velocities) and returning a flat list."""

    M: Callable[..., list[float]]  # (n * n) mass matrix, row by row
    h: Callable[..., list[float]]  # (n) bias, undamped
    K: Callable[..., list[float]]  # (n * n) second derivatives of the strain energy
    energy: Callable[..., list[float]]  # (1) kinetic + strain energy
    momentum: Callable[..., list[float]]  # (3) linear x, y and angular about the inertial origin


class Point(NamedTuple):
    """Functions of the end point of a chain, called like those of a Body."""

    position: Callable[..., list[float]]  # (2)
    J: Callable[..., list[float]]  # (2 * n)
    Jd_zd: Callable[..., list[float]]  # (2)


class Panel(NamedTuple):
    """A panel of one element in its floating frame: symbols and matrices of Eqs. 45, 47 and 48."""

    m: sp.Symbol
    L: sp.Symbol
    EA: sp.Symbol
    EI: sp.Symbol
    q: list[sp.Symbol]  # root x, root y, delta, q4, q5, q6
    qd: list[sp.Symbol]
    M: sp.Matrix  # (6, 6)
    K: sp.Matrix  # (6, 6)
    Q_v: sp.Matrix  # (6, 1), so that M qdd + K q = Q_e + Q_v


@cache
def floating_panel() -> Panel:
    """Derive Eqs. 45, 47 and 48 for a panel of one element from its energies, in symbols."""
    m, L = sp.symbols("m L", positive=True)
    x, y, delta, q4, q5, q6 = q = list(sp.symbols("x y delta q4:7", real=True))
    qd = list(sp.symbols("xd yd deltad qd4:7", real=True))
    EA, EI = sp.symbols("EA EI", positive=True)
    # The base is the floating frame itself; its root is at the origin and its first node does not move.
    coordinates, rates = [x, y, delta, 0, 0, 0, q4, q5, q6], [*qd[:3], 0, 0, 0, *qd[3:]]
    T, V, _ = _element_energies((0, 0, 0, 0, L, m / L, EA, EI), coordinates, rates)
    M, h, K = _euler_lagrange(T, V, q, qd)
    return Panel(m, L, EA, EI, q, qd, M, K, K * sp.Matrix(q) - h)


def _rotation(angle: sp.Expr) -> sp.Matrix:
    return sp.Matrix([[sp.cos(angle), -sp.sin(angle)], [sp.sin(angle), sp.cos(angle)]])


def _cross(a: sp.Matrix, b: sp.Matrix) -> sp.Expr:
    return a[0] * b[1] - a[1] * b[0]


def _rate(expression: sp.Matrix, z: list[Any], zd: list[Any]) -> sp.Matrix:
    """Differentiate with respect to time by the chain rule; entries of z that are numbers do not move."""
    total = sp.zeros(*expression.shape)
    for coordinate, velocity in zip(z, zd, strict=True):
        if isinstance(coordinate, sp.Symbol):
            total += sp.diff(expression, coordinate) * velocity
    return total


def _euler_lagrange(
    T: sp.Expr, V: sp.Expr, z: list[sp.Symbol], zd: list[sp.Symbol]
) -> tuple[sp.Matrix, sp.Matrix, sp.Matrix]:
    """Return M, h and the Hessian of V from d/dt (dL/dzd) - dL/dz = M zdd + h, L = T - V."""
    momenta = sp.Matrix([sp.diff(T, velocity) for velocity in zd])
    M = momenta.jacobian(zd)
    gradient = sp.Matrix([sp.diff(T - V, coordinate) for coordinate in z])
    return M, _rate(momenta, z, zd) - gradient, sp.hessian(V, z)


def _lambdify(arguments: list[sp.Symbol], expressions: Any) -> Callable[..., list[float]]:
    return sp.lambdify(arguments, list(expressions), modules="math", cse=True)


def _body(
    parameters: list[sp.Symbol],
    z: list[sp.Symbol],
    zd: list[sp.Symbol],
    energies: tuple[sp.Expr, sp.Expr, list[sp.Expr]],
) -> Body:
    T, V, momentum = energies
    M, h, K = _euler_lagrange(T, V, z, zd)
    return Body(*(_lambdify([*parameters, *z, *zd], part) for part in (M, h, K, [T + V], momentum)))


def _coordinates(count: int) -> tuple[list[sp.Symbol], list[sp.Symbol]]:
    return list(sp.symbols(f"z:{count}", real=True)), list(sp.symbols(f"zd:{count}", real=True))


def _rigid_energies(
    bodies: list[tuple[Any, Any, sp.Matrix, Any]], z: list[sp.Symbol], zd: list[sp.Symbol]
) -> tuple[sp.Expr, sp.Expr, list[sp.Expr]]:
    """Return T, V = 0 and (px, py, Lz) of rigid bodies (mass, inertia, centre of mass, orientation)."""
    T, linear, angular = sp.Integer(0), sp.zeros(2, 1), sp.Integer(0)
    for mass, inertia, centre, angle in bodies:
        velocity, spin = _rate(centre, z, zd), _rate(sp.Matrix([angle]), z, zd)[0]
        T += mass * velocity.dot(velocity) / 2 + inertia * spin**2 / 2
        linear += mass * velocity
        angular += mass * _cross(centre, velocity) + inertia * spin
    return T, sp.Integer(0), [*linear, angular]


@cache
def rigid_body() -> Body:
    """Build the base or the object. Parameters: mass, inertia; coordinates: x, y, orientation."""
    mass, inertia = parameters = list(sp.symbols("m I", positive=True))
    z, zd = _coordinates(N_POSE)
    return _body(parameters, z, zd, _rigid_energies([(mass, inertia, sp.Matrix(z[:2]), z[2])], z, zd))


def _chain(n_links: int) -> tuple[list[sp.Symbol], list[sp.Symbol], list[sp.Symbol], list[Any], sp.Matrix]:
    """Return parameters, coordinates, rates, bodies and end point of an arm.

    Parameters: mount x, mount y, mount angle, then mass, length, inertia, distance to the centre of mass of each link.
    """
    mount_x, mount_y, mount_angle = parameters = list(sp.symbols("mount_x mount_y mount_angle", real=True))
    z, zd = _coordinates(N_POSE + n_links)
    end = sp.Matrix(z[:2]) + _rotation(z[2]) * sp.Matrix([mount_x, mount_y])
    angle = z[2] + mount_angle
    bodies = []
    for k in range(n_links):
        mass, length, inertia, com = numbers = sp.symbols(f"m{k} l{k} I{k} c{k}", positive=True)
        parameters.extend(numbers)
        angle += z[N_POSE + k]
        along = sp.Matrix([sp.cos(angle), sp.sin(angle)])
        bodies.append((mass, inertia, end + com * along, angle))
        end = end + length * along
    return parameters, z, zd, bodies, end


@cache
def links(n_links: int) -> Body:
    """Build the links of an arm, without the base."""
    parameters, z, zd, bodies, _ = _chain(n_links)
    return _body(parameters, z, zd, _rigid_energies(bodies, z, zd))


@cache
def tip(n_links: int) -> Point:
    """Build the end point of an arm; with no links, the point of a body at (mount x, mount y)."""
    parameters, z, zd, _, end = _chain(n_links)
    arguments = [*parameters, *z, *zd]
    acceleration = _rate(_rate(end, z, zd), z, zd)
    return Point(*(_lambdify(arguments, part) for part in (end, end.jacobian(z), acceleration)))


def _element_energies(parameters: Any, z: list[Any], zd: list[Any]) -> tuple[sp.Expr, sp.Expr, list[sp.Expr]]:
    """Return T, V and (px, py, Lz) of one Hermite element, integrated exactly over its length.

    Args:
        parameters: root x, root y, angle of the panel in the base's frame, distance of the element from the root,
            its length, mass per length, EA, EI.
        z: base x, y, beta, then (u, w, slope) of the near and of the far node.
        zd: rates of z.

    """
    root_x, root_y, panel_angle, start, length, density, EA, EI = parameters
    x, y, beta, u0, w0, slope0, u1, w1, slope1 = z
    xi = sp.Symbol("xi", real=True)
    u = u0 * (1 - xi) + u1 * xi
    w = w0 * (1 - 3 * xi**2 + 2 * xi**3) + w1 * (3 * xi**2 - 2 * xi**3)
    w += length * (slope0 * (xi - 2 * xi**2 + xi**3) + slope1 * (xi**3 - xi**2))
    strain = sp.diff(u, xi) / length
    curvature = sp.diff(w, xi, 2) / length**2
    V = sp.integrate(sp.expand(EA * strain**2 + EI * curvature**2), (xi, 0, 1)) * length / 2

    # A point of the element is the polynomial sum_k r_k xi^k, and the integral of xi^j xi^k is 1 / (j + k + 1).
    field = sp.Matrix([start + length * xi + u, w]).applyfunc(sp.expand)
    degrees = range(4)
    r = [_rotation(beta + panel_angle) * field.applyfunc(lambda entry, k=k: entry.coeff(xi, k)) for k in degrees]
    r[0] += sp.Matrix([x, y]) + _rotation(beta) * sp.Matrix([root_x, root_y])
    v = [_rate(part, z, zd) for part in r]
    mass = density * length
    pairs = [(j, k, sp.Rational(1, j + k + 1)) for j in degrees for k in degrees]
    T = mass / 2 * sum(weight * v[j].dot(v[k]) for j, k, weight in pairs)
    linear = sum((mass * sp.Rational(1, k + 1) * v[k] for k in degrees), sp.zeros(2, 1))
    angular = mass * sum(weight * _cross(r[j], v[k]) for j, k, weight in pairs)
    return T, V, [*linear, angular]


@cache
def element() -> Body:
    """Build one Hermite element of a panel; see `_element_energies` for its parameters and coordinates."""
    names = "root_x root_y angle start length density EA EI"
    parameters = list(sp.symbols(names, real=True))
    z, zd = _coordinates(N_POSE + 2 * N_NODE)
    return _body(parameters, z, zd, _element_energies(parameters, z, zd))
