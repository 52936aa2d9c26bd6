"""Whose signs are flipped, which check sees them, and which signs are free; see ``flips``."""

from __future__ import annotations

PHYSICS, TASK, LAWS = "sffr_gym/physics", "sffr_gym/task", "baselines/sffr_baselines"
EQUATIONS_OF_MOTION = {  # file: function: equations that it computes
    f"{PHYSICS}/panel.py": {"condense": "45, 48", "expand": "45"},
    f"{PHYSICS}/beam.py": {"shape_functions": "44", "beam": "45, 47"},
    f"{PHYSICS}/monolithic.py": {
        "panel_equations": "45, 48", "rigid_equations": "41", "root_jacobian": "49",
        "assemble": "52", "constraint_jacobian": "8",
    },
    f"{PHYSICS}/kinematics.py": {
        "base_point": "49", "arm_points": "41", "rotation": "41", "perpendicular": "41", "_beyond": "41",
    },
    f"{PHYSICS}/arms.py": {"link_directions": "41", "articulate": "41", "expand": "41", "tip_motion": "41"},
    f"{PHYSICS}/dynamics.py": {
        "_attach": "41, 52", "_base_inertia": "52", "_distribute": "41", "_root_acceleration": "49",
        "flexible_wrench": "52",
    },
    f"{PHYSICS}/grasp.py": {"couple_object": "8", "solve_object": "8"},
}  # fmt: skip
LOOP = {  # file: function: what it computes
    f"{PHYSICS}/etdrk4.py": {
        "etdrk4_step": "step", "_extrapolate": "stages", "_constant_forcing": "ETDRK4", "_quadratic_forcing": "ETDRK4",
    },
    f"{PHYSICS}/stiff_modes.py": {
        "freeze": "ETDRK4", "take_out": "ETDRK4", "_transition": "ETDRK4", "_rotate": "Jacobi",
    },
    f"{PHYSICS}/rk4.py": {"rk4_step": "RK4"},
    f"{PHYSICS}/foreshortening.py": {
        "condense_bent": "d'Alembert", "_move_inward": "d'Alembert", "_stiffen": "curvature", "_dot": "vectors",
        "_plus": "vectors", "tip_foreshortening": "tip", "panel_inertia": "energy",
    },
    f"{PHYSICS}/actuators.py": {
        "pack_actuators": "15", "generalized_forces": "14", "modulate": "PWPF", "quantise": "steps", "_follow": "lag",
        "_lag": "lag",
    },
    f"{TASK}/reference.py": {
        "path_reference": "formation", "desired": "path", "_on_figure_eight": "path", "_on_pieces": "path",
        "_polynomial": "path", "_along": "heading",
    },
    f"{TASK}/observation.py": {"observe": "errors", "_write": "axes"},
    f"{TASK}/signals.py": {"measure_state": "signals", "measure_command": "signals", "_bending": "signals"},
    f"{TASK}/quasi_static.py": {"quasi_static_amplitude": "quasi-static", "panel_push": "quasi-static"},
    f"{TASK}/episode_start.py": {
        "_leave": "path", "_excite": "modes", "_bend": "quasi-static", "_shift": "rigid motion",
        "_put_impulses": "impulse",
    },
    f"{TASK}/status.py": {"_elbow": "ends", "_gap": "ends"},
    f"{TASK}/reward.py": {"reward_terms": "reward"},
    f"{TASK}/control_period.py": {"control_period": "wrench"},
    f"{TASK}/disturbances.py": {"impulse_wrench": "impulse", "_add_pair": "noise"},
    f"{LAWS}/mic.py": {
        "ask": "9, 12", "answer": "12", "_links": "41", "_grip_forces": "9-11", "_reach": "12",
        "_inverse_dynamics": "6, 7, 13",
    },
    f"{LAWS}/free_floating.py": {"float_base": "momentum", "_solve": "Cramer"},
    f"{LAWS}/suppression.py": {"suppress": "20, 48", "_adapt": "24, 39"},
    f"{LAWS}/regulator.py": {
        "make_regulator": "root", "optimal_gain": "Riccati", "sampled_panel": "sampling", "regulate": "feedback",
        "deviate": "quasi-static",
        "worth_of_effort": "score", "root_acceleration": "quasi-static",
    },
    f"{LAWS}/predictive.py": {"problem": "programme", "predict": "limits", "solve": "gradient"},
    f"{LAWS}/position_feedback.py": {
        "_filters": "modes", "sampled_filter": "sampling", "feed_back": "filter",
    },
    f"{LAWS}/panel_reaction.py": {"make_panel_reaction": "2", "add_panel_reaction": "2-4, 45, 48"},
    f"{LAWS}/observer.py": {
        "tracked_errors": "formation", "_kalman_gain": "Riccati", "integrate": "integral", "_correct": "prediction",
        "_reference_motion": "path", "_lag": "delay",
    },
    f"{LAWS}/schedule.py": {
        "_write_features": "features", "_write_products": "features", "base_off_path": "weight",
        "apply_decision": "weight", "_propagate": "network",
    },
    f"{LAWS}/stability.py": {"feedback_growth": "sampling", "_sampled_modes": "sampling"},
}  # fmt: skip
CONFIG = "configs/sffr.yaml"
TERMS = EQUATIONS_OF_MOTION | LOOP
STEPS = ["test_integrator.py", "-k", "one_step or exact_oscillators or slow"]
PERIOD = [
    "test_observation.py", "test_episode_end.py", "test_env.py", "test_disturbances.py", "-k",
    "terminates or info or reward or cost or simulator or momentum",
]  # fmt: skip
STARTS = "(test_episode_start and not many and not copies and not state) or bent_by_it or test_scenario"
TESTS = {  # that check the files of LOOP, and others where the sections see nothing, as arguments of pytest
    f"{PHYSICS}/etdrk4.py": STEPS, f"{PHYSICS}/stiff_modes.py": STEPS, f"{PHYSICS}/rk4.py": STEPS,
    f"{PHYSICS}/foreshortening.py": ["test_foreshortening.py", "-k", "lagrange or sensors or mass_matrix or stiffens"],
    f"{PHYSICS}/actuators.py": [
        "test_actuators.py", "test_actuation.py", "-k",
        "not environments and not valves and not diverges and not loop and not sensors and not half and not what_was",
    ],
    f"{PHYSICS}/dynamics.py": ["test_foreshortening.py", "-k", "lagrange"],  # whose panels couple along and across
    f"{TASK}/reference.py": [
        "test_observation.py", "test_reference.py", "test_paths.py", "-k",
        "test_observation or test_reference or derivatives or lobes or begins or passed or tangent",
    ],
    f"{TASK}/observation.py": [
        "test_observation.py", "test_mic.py", "test_foreshortening.py", "-k", "test_observation or three or sensors",
    ],
    f"{TASK}/signals.py": [
        *PERIOD[:-2], "test_quasi_static.py", "test_signals.py", "-k", f"{PERIOD[-1]} or quasi_static or test_signals",
    ],
    f"{TASK}/quasi_static.py": ["test_quasi_static.py"], f"{TASK}/status.py": PERIOD,
    f"{TASK}/episode_start.py": ["test_episode_start.py", "test_episode.py", "test_scenario.py", "-k", STARTS],
    f"{TASK}/reward.py": PERIOD, f"{TASK}/control_period.py": PERIOD,
    f"{TASK}/disturbances.py": ["test_disturbances.py", "-k", "philox or momentum or white"],
    f"{LAWS}/free_floating.py": ["test_free_floating.py", "-k", "cramers or first_period or (tracked and none)"],
    f"{LAWS}/mic.py": ["test_mic.py"], f"{LAWS}/suppression.py": ["test_suppression.py"],
    f"{LAWS}/regulator.py": ["test_regulator.py", "-k", "not ahsc"],  # whole circles take the interpreter minutes
    f"{LAWS}/predictive.py": ["test_predictive.py", "-k", "problem or osqps"],
    f"{LAWS}/position_feedback.py": ["test_position_feedback.py", "-k", "sampled or modes_are or piezos_are or left"],
    f"{LAWS}/panel_reaction.py": ["test_panel_reaction.py", "-k", "commanded or limits"],
    f"{LAWS}/observer.py": [
        "test_observer.py", "-k", "tells or late or lag_is or integrals or gain or tracked or levers or prediction",
    ],
    f"{LAWS}/schedule.py": [
        "test_schedule.py", "test_damping_env.py", "-k",
        "test_schedule or multiplies_a or beyond_its or mirrored or without_any",
    ],
    f"{LAWS}/stability.py": [
        "test_stability.py", "test_scheduled.py", "-k", "axial_growth or whole_state_space or regulated_panel",
    ],
}  # fmt: skip
DERIVATION = "sffr_workbench.verify.panel_symbols"  # SymPy's, slow and of nothing that is flipped: kept
# Sections that see a file, the fastest first; all the others that need no long run come after them.
FIRST = {f"{PHYSICS}/beam.py": ("equations",), f"{PHYSICS}/kinematics.py": ("rigid",)}
SECTIONS = ("coupling", "rigid", "equations")
COUNTS = {"start", "at", "n", "n_a", "n_f", "n_m", "n_g", "n_modes", "N_BASE", "N_TIP", "elements", "element", "size"}
SQUARED = {"dU", "d2W"}  # arrays that enter the equations as squares: the sign of all entries at once is free
FREE = {  # function, term: why its sign makes no difference
    ("_rotate", "1.0 / sqrt(t * t + 1.0)"): "a rotation by half a turn more",
    ("worth_of_effort", "swing * modes.shapes[BENDING, 0] / modes.shapes[BENDING.start, 0]"): "swings of either side",
    ("worth_of_effort", "np.zeros_like(M)"): "zero",
    ("problem", "unknown"): "the cost is a square of the unknowns",
    ("_filters", "settings.swing / shapes[0, 0]"): "its magnitude is taken",
    ("_kalman_gain", "1.0e-30 * np.eye(2)"): "far below rounding",
    ("_write_features", "side / size"): "a motion and its mirror image, seen the other way around for all panels",
    ("apply_decision", "base_off_path(law, obs) / schedule.tolerance"): "it enters as its square",
    ("freeze", "weight * p[stiff.at[k]]"): "amplitudes count from anywhere: what is split off them is given back",
    ("freeze", "weight * v[stiff.at[k]]"): "rates likewise: steady motion is quadratic forcing, which is exact",
    ("_transition", "rate * duration"): "a cosine is even, and its sine is turned around as a whole",
    ("_transition", "decay * duration"): "of a mode that is critically damped to the last bit",
    ("_on_figure_eight", "2.0 * angle"): "a cosine is even, and its sine is turned around as a whole",
    ("_shift", "offset[1] * numbers[at + 2]"): "a turn to either side is as likely",
    ("_put_impulses", "size * cos(direction)"): "an impulse the other way is as likely",
    ("_put_impulses", "cos(direction)"): "an impulse the other way is as likely",
    ("_put_impulses", "size * sin(direction)"): "an impulse the other way is as likely",
    ("_put_impulses", "sin(direction)"): "an impulse the other way is as likely",
    ("_put_impulses", "numbers[at + 3] * draws.moment[k]"): "a moment the other way is as likely",
    ("_add_pair", "2.0 * pi * (float(b) + 0.5) * TO_UNIT"): "an angle that is as likely",
    ("_add_pair", "float(b)"): "an angle that is as likely",
    ("_add_pair", "0.5"): "half of the least step of an angle",
    ("_add_pair", "level[k] * size * cos(angle)"): "noise of either sign is as likely",
    ("_add_pair", "level[k + 1] * size * sin(angle)"): "noise of either sign is as likely",
}
ZERO = "0.0 * "  # of the kind of number that follows, of either sign
MAKERS = {"slice", "range", "zeros", "empty", "eye", "len", "base_point", "arm_points"}  # calls that give no numbers
