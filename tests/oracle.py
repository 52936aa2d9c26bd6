"""Monolithic Lagrangian of the robot, derived by SymPy from the energies alone (Euler-Lagrange; compare Eqs. 40-53).

It shares no code and no method with the simulator that it checks.

Coordinates: z = [x, y, beta, joint angles arm by arm, elastic coordinates panel by panel], where a panel of E Hermite
elements has (u, w, slope) at its nodes 1..E, root to tip; node 0 is the clamped root, and with E = 1 the three are q4,
q5, q6 of Eq. 44. Each body (base, arm, element of a panel, object) gets its kinetic and strain energy on the few
coordinates it depends on; the sums over the bodies are the robot's M, h and energy, with

    M(z) zdd + h(z, zd) = Q,    h_i = d/dt (dT/dzd_i) at zdd = 0  -  dT/dz_i  +  dV/dz_i  +  (eta K zd)_i.

Every body carries the base's x, y and beta as its first three coordinates. Angles are positive counterclockwise.
`panel.axial_cut` and `panel.bending_cut` have no meaning here: all elastic coordinates are kept.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

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


class Term(NamedTuple):
    """One body or point of the robot: its functions, its numbers, and where its coordinates stand in z."""

    functions: Any  # Body or Point
    parameters: tuple[float, ...]
    place: NDArray[np.intp]


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


class Oracle:
    """The free robot, or the robot with its object, from a configuration in the layout of `configs/sffr.yaml`.

    Attributes: `N` coordinates of which the first `n_rigid` are the rigid ones, `n_arms`, `n_panels`, `elements`,
    `eta` the strain-rate damping, `K` (N, N) the stiffness matrix and `grasps` [(arm index, Point term), ...].
    """

    def __init__(self, config: dict[str, Any]) -> None:
        """Build the bodies of `config`; `panel` and `object` may be null, and `arms` and `mounts` empty."""
        base, arms, panel = config["base"], config.get("arms") or [], config.get("panel") or {}
        mounts = panel["mounts"] if panel else []
        self.elements = int(panel["elements"]) if panel else 0
        self.eta = float(panel["strain_rate_damping"]) if panel else 0.0
        self.n_arms, self.n_panels = len(arms), len(mounts)
        self.n_rigid = N_POSE + sum(len(arm["links"]) for arm in arms)
        self.N = self.n_rigid + N_NODE * self.elements * self.n_panels

        pose = list(range(N_POSE))
        self._rigid_terms = [Term(_rigid_body(), _floats(base["mass"], base["inertia"]), np.array(pose))]
        self._tips: list[Term] = []
        first = N_POSE
        for arm in arms:
            links = arm["links"]
            numbers = [(link["mass"], link["length"], link["inertia"], link["com"]) for link in links]
            parameters = _floats(*arm["mount"], arm["mount_angle"], *(value for link in numbers for value in link))
            index = np.array(pose + list(range(first, first + len(links))))
            self._rigid_terms.append(Term(_links(len(links)), parameters, index))
            self._tips.append(Term(_tip(len(links)), parameters, index))
            first += len(links)

        # The clamped node of every panel is kept as three more coordinates, N..N+2, that are zero and cut off.
        self._panel_terms: list[Term] = []
        clamped = list(range(self.N, self.N + N_NODE))
        for mount in mounts:
            length, mass = float(panel["length"]), float(panel["mass"])
            size = length / self.elements
            stiffness = (float(panel["E"]) * float(panel["area"]), panel["EI"])
            near = clamped
            for element in range(self.elements):
                far = list(range(first, first + N_NODE))
                parameters = _floats(*mount["root"], mount["angle"], element * size, size, mass / length, *stiffness)
                self._panel_terms.append(Term(_element(), parameters, np.array(pose + near + far)))
                near, first = far, first + N_NODE

        self._object: Term | None = None
        self.grasps: list[tuple[int, Term]] = []
        body = config.get("object")
        if body:
            names = [arm["name"] for arm in arms]
            self._object = Term(_rigid_body(), _floats(body["mass"], body["inertia"]), np.array(pose))
            for grasp in body["grasps"]:
                point = Term(_tip(0), _floats(*grasp["point"], 0.0), np.array(pose))
                self.grasps.append((names.index(grasp["arm"]), point))

        zero = np.zeros(self.N)
        self.K = self._matrix("K", self._panel_terms, zero)

    def mass_matrix(self, z: ArrayLike) -> Array:
        """Return M(z), (N, N)."""
        return self._matrix("M", self._rigid_terms + self._panel_terms, z)

    def bias(self, z: ArrayLike, zd: ArrayLike, damping: bool = True) -> Array:
        """Return h(z, zd), (N,), with the elastic forces and, if `damping`, with D zd, where D = eta K."""
        h = self._vector("h", self._rigid_terms + self._panel_terms, z, zd)
        return h + self.eta * self.K @ np.asarray(zd, dtype=float) if damping else h

    def energy(self, z: ArrayLike, zd: ArrayLike) -> float:
        """Return the kinetic and strain energy of the robot without the object, in J."""
        return float(sum(_call(term, "energy", *self._pad(z, zd))[0] for term in self._rigid_terms + self._panel_terms))

    def momentum(self, z: ArrayLike, zd: ArrayLike) -> Array:
        """Return (px, py, Lz) of the robot without the object: sums of m v and of r x m v, inertial."""
        total: Array = np.zeros(3)
        for term in self._rigid_terms + self._panel_terms:
            total += _call(term, "momentum", *self._pad(z, zd))
        return total

    def tip(self, z: ArrayLike, arm_index: int) -> Array:
        """Return the inertial position of the end of an arm, (2,)."""
        return np.array(_call(self._tips[arm_index], "position", *self._pad(z)))

    def tip_jacobian(self, z: ArrayLike, arm_index: int) -> Array:
        """Return J, (2, N), so that J zd is the velocity of the end of the arm."""
        term = self._tips[arm_index]
        J = np.zeros((2, self.N))
        J[:, term.place] = np.reshape(_call(term, "J", *self._pad(z)), (2, -1))
        return J

    def tip_jacobian_dot_zd(self, z: ArrayLike, zd: ArrayLike, arm_index: int) -> Array:
        """Return (dJ/dt) zd, (2,)."""
        return np.array(_call(self._tips[arm_index], "Jd_zd", *self._pad(z, zd)))

    def acceleration(self, z: ArrayLike, zd: ArrayLike, Q: ArrayLike, damping: bool = True) -> Array:
        """Return zdd of the free robot under the generalised force Q, (N,)."""
        return np.linalg.solve(self.mass_matrix(z), np.asarray(Q, dtype=float) - self.bias(z, zd, damping))

    def constrained(
        self,
        z: ArrayLike,
        zd: ArrayLike,
        obj: ArrayLike,
        objd: ArrayLike,
        Q: ArrayLike,
        damping: bool = True,
        Q_obj: ArrayLike = (0.0, 0.0, 0.0),
    ) -> tuple[Array, Array, Array]:
        """Solve the robot and its object, pinned together at the grasps, at the level of the accelerations.

            M zdd + h = Q + sum_i J_i^T lam_i,    M_o objdd = Q_obj - sum_i G_i^T lam_i,
            J_i zdd + Jd_i zd = G_i objdd + Gd_i objd,

        where J_i zd is the velocity of the tip and G_i objd that of the grasp point. Nothing is stabilised.

        Args:
            z: (N,) coordinates of the robot.
            zd: (N,) their rates.
            obj: (3,) position of the object's centre of mass and its orientation.
            objd: (3,) their rates.
            Q: (N,) generalised force on the robot.
            damping: whether the panels are damped.
            Q_obj: (3,) other forces and torque on the object.

        Returns:
            zdd (N,), objdd (3,) and lam (number of grasps, 2) [N], the force of the object on the arm's tip in
            inertial axes, in the order of the configuration.

        Raises:
            ValueError: the configuration has no object.

        """
        if self._object is None:
            raise ValueError("the configuration has no object")
        obj, objd = np.asarray(obj, dtype=float), np.asarray(objd, dtype=float)
        n_lam = 2 * len(self.grasps)
        J, G = np.zeros((n_lam, self.N)), np.zeros((n_lam, N_POSE))
        drift = np.zeros(n_lam)  # acceleration of the gaps at zdd = 0, objdd = 0
        for i, (arm_index, point) in enumerate(self.grasps):
            rows = slice(2 * i, 2 * i + 2)
            J[rows] = self.tip_jacobian(z, arm_index)
            G[rows] = np.reshape(_call(point, "J", obj, objd), (2, N_POSE))
            drift[rows] = self.tip_jacobian_dot_zd(z, zd, arm_index) - _call(point, "Jd_zd", obj, objd)
        M_obj = np.reshape(_call(self._object, "M", obj, objd), (N_POSE, N_POSE))
        M = np.zeros((self.N + N_POSE, self.N + N_POSE))
        M[: self.N, : self.N] = self.mass_matrix(z)
        M[self.N :, self.N :] = M_obj
        A = np.hstack([J, -G])
        kkt = np.block([[M, -A.T], [A, np.zeros((n_lam, n_lam))]])
        force = np.asarray(Q, dtype=float) - self.bias(z, zd, damping)
        force_obj = np.asarray(Q_obj, dtype=float) - _call(self._object, "h", obj, objd)
        solution = np.linalg.solve(kkt, np.concatenate([force, force_obj, -drift]))
        zdd, objdd, lam = np.split(solution, [self.N, self.N + N_POSE])
        return zdd, objdd, lam.reshape(-1, 2)

    def q_flex(self, z: ArrayLike, zd: ArrayLike, zdd: ArrayLike) -> Array:
        """Return the force of the panels on the rigid coordinates, (n_rigid,): H qdd + C = Q + Q_flex (Eq. 3).

        It is minus the panels' part of the rigid rows of M zdd + h.
        """
        M = self._matrix("M", self._panel_terms, z)
        h = self._vector("h", self._panel_terms, z, zd)
        return -(M @ np.asarray(zdd, dtype=float) + h)[: self.n_rigid]

    def grasp_gaps(self, z: ArrayLike, obj: ArrayLike) -> Array:
        """Return the tips minus the points of the object that they hold, (number of grasps, 2)."""
        obj = np.asarray(obj, dtype=float)
        points = [_call(point, "position", obj, np.zeros(N_POSE)) for _, point in self.grasps]
        return np.array([self.tip(z, arm_index) for arm_index, _ in self.grasps]) - np.array(points)

    def _pad(self, z: ArrayLike, zd: ArrayLike | None = None) -> tuple[Array, Array]:
        """Return z and zd (or zeros) with the clamped coordinates behind them."""
        padded = np.zeros((2, self.N + N_NODE))
        padded[0, : self.N] = z
        if zd is not None:
            padded[1, : self.N] = zd
        return padded[0], padded[1]

    def _matrix(self, name: str, terms: list[Term], z: ArrayLike) -> Array:
        """Sum a matrix function of the bodies into (N, N)."""
        total = np.zeros((self.N + N_NODE, self.N + N_NODE))
        for term in terms:
            n = len(term.place)
            total[np.ix_(term.place, term.place)] += np.reshape(_call(term, name, *self._pad(z)), (n, n))
        return total[: self.N, : self.N]

    def _vector(self, name: str, terms: list[Term], z: ArrayLike, zd: ArrayLike) -> Array:
        """Sum a vector function of the bodies into (N,)."""
        total = np.zeros(self.N + N_NODE)
        for term in terms:
            total[term.place] += _call(term, name, *self._pad(z, zd))
        return total[: self.N]


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


def _call(term: Term, name: str, z: Array, zd: Array) -> list[float]:
    """Evaluate one function of a body or point on its own part of z and zd, as Python floats (faster than NumPy's)."""
    function = getattr(term.functions, name)
    return function(*term.parameters, *z[term.place].tolist(), *zd[term.place].tolist())


def _floats(*values: Any) -> tuple[float, ...]:
    """Convert numbers, and those that PyYAML reads as strings (60.0e9), to floats."""
    return tuple(float(value) for value in values)


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
def _rigid_body() -> Body:
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
def _links(n_links: int) -> Body:
    """Build the links of an arm, without the base."""
    parameters, z, zd, bodies, _ = _chain(n_links)
    return _body(parameters, z, zd, _rigid_energies(bodies, z, zd))


@cache
def _tip(n_links: int) -> Point:
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
def _element() -> Body:
    """Build one Hermite element of a panel; see `_element_energies` for its parameters and coordinates."""
    names = "root_x root_y angle start length density EA EI"
    parameters = list(sp.symbols(names, real=True))
    z, zd = _coordinates(N_POSE + 2 * N_NODE)
    return _body(parameters, z, zd, _element_energies(parameters, z, zd))
