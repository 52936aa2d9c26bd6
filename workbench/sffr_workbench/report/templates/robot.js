/** Where the robot's parts are in a state; [x, y] in metres, inertial axes unless said otherwise. */

function turned([x, y], angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return [c * x - s * y, s * x + c * y];
}

function plus([x, y], [u, v], factor = 1) {
  return [x + factor * u, y + factor * v];
}

/** A point of the base's axes. */
function fromBase(state, point) {
  return plus(state.base, turned(point, state.base[2]));
}

/** The corners of a square of side 2 half, turned and put somewhere. */
function square([x, y, angle], half) {
  return [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([a, b]) => plus([x, y], turned([half * a, half * b], angle)));
}

/** Mount, joints and tip of an arm. */
function armLine(state, arm) {
  const [x, y, angle] = arm.mount;
  const points = [fromBase(state, [x, y])];
  let way = state.base[2] + angle;
  arm.links.forEach((length, k) => {
    way += state.joints[arm.first + k];
    points.push(plus(points[k], [Math.cos(way), Math.sin(way)], length));
  });
  return points;
}

/** Transverse deflections [m] of panel `k` at its places `x` for all panels' modal amplitudes. */
function deflections(robot, k, amplitudes) {
  const { shapes } = robot.panels[k];
  const count = shapes[0].length;
  return shapes.map((shape) => shape.reduce((sum, value, m) => sum + value * amplitudes[k * count + m], 0));
}

/** A point of panel `k`'s axes, from its root along and across. */
function fromPanel(robot, state, k, along, across) {
  const { root, axis: [c, s] } = robot.panels[k];
  return fromBase(state, [root[0] + c * along - s * across, root[1] + s * along + c * across]);
}

/** The panel's line from root to tip with deflections `factor` times as large. */
function panelLine(robot, state, k, amplitudes, factor) {
  const bent = deflections(robot, k, amplitudes);
  return robot.panels[k].x.map((x, i) => fromPanel(robot, state, k, x, factor * bent[i]));
}

/** The ends of a panel's recent swing as its tip's deflections, about where the tip would be now without swing. */
function swingEnds(recording, state, k, t) {
  const rest = state.tips[k] - state.swing[k];
  return recording.swing(t, k).map((swing) => rest + swing);
}

/** The place between two points of the path: `part` counts points from the start. */
function onPath({ points }, part) {
  const first = Math.min(Math.floor(part), points.length - 2);
  const [a, b] = points.slice(first, first + 2);
  return [0, 1].map((axis) => a[axis] + (part - first) * (b[axis] - a[axis]));
}

/** The colour of a voltage: the panel's own at zero, on a logarithmic scale to those of the limit on either side. */
function voltageColour(volts, limit) {
  const least = 0.01; // V whose colour can hardly be told from none
  const share = Math.min(Math.log1p(Math.abs(volts) / least) / Math.log1p(limit / least), 1);
  return mix(Theme.colours.panel, volts > 0 ? Theme.colours.positive : Theme.colours.negative, share);
}
