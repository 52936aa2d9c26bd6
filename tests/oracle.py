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

from typing import Any, NamedTuple

import lagrangian
import numpy as np
from lagrangian import N_NODE, N_POSE
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Term(NamedTuple):
    """One body or point of the robot: its functions, its numbers, and where its coordinates stand in z."""

    functions: Any  # lagrangian.Body or lagrangian.Point
    parameters: tuple[float, ...]
    place: NDArray[np.intp]


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
        self._rigid_terms = [Term(lagrangian.rigid_body(), _floats(base["mass"], base["inertia"]), np.array(pose))]
        self._tips: list[Term] = []
        first = N_POSE
        for arm in arms:
            links = arm["links"]
            numbers = [(link["mass"], link["length"], link["inertia"], link["com"]) for link in links]
            parameters = _floats(*arm["mount"], arm["mount_angle"], *(value for link in numbers for value in link))
            index = np.array(pose + list(range(first, first + len(links))))
            self._rigid_terms.append(Term(lagrangian.links(len(links)), parameters, index))
            self._tips.append(Term(lagrangian.tip(len(links)), parameters, index))
            first += len(links)

        # The clamped node of every panel is kept as three more coordinates, N..N+2, that are zero and cut off.
        self._panel_terms: list[Term] = []
        clamped = list(range(self.N, self.N + N_NODE))
        for mount in mounts:
            own = {key: panel[key] if mount.get(key) is None else mount[key] for key in ("length", "mass", "EI")}
            length, mass = float(own["length"]), float(own["mass"])
            size = length / self.elements
            stiffness = (float(panel["E"]) * float(panel["area"]), own["EI"])
            near = clamped
            for element in range(self.elements):
                far = list(range(first, first + N_NODE))
                parameters = _floats(*mount["root"], mount["angle"], element * size, size, mass / length, *stiffness)
                self._panel_terms.append(Term(lagrangian.element(), parameters, np.array(pose + near + far)))
                near, first = far, first + N_NODE

        self._object: Term | None = None
        self.grasps: list[tuple[int, Term]] = []
        body = config.get("object")
        if body:
            names = [arm["name"] for arm in arms]
            self._object = Term(lagrangian.rigid_body(), _floats(body["mass"], body["inertia"]), np.array(pose))
            for grasp in body["grasps"]:
                point = Term(lagrangian.tip(0), _floats(*grasp["point"], 0.0), np.array(pose))
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


def _call(term: Term, name: str, z: Array, zd: Array) -> list[float]:
    """Evaluate one function of a body or point on its own part of z and zd, as Python floats (faster than NumPy's)."""
    function = getattr(term.functions, name)
    return function(*term.parameters, *z[term.place].tolist(), *zd[term.place].tolist())


def _floats(*values: Any) -> tuple[float, ...]:
    """Convert numbers, and those that PyYAML reads as strings (60.0e9), to floats."""
    return tuple(float(value) for value in values)
