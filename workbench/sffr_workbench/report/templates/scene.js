/** The robot on its path, as several policies move it: the first one in full, the others' panels and outlines. */
class Scene {
  static MARGIN = 0.35; // m around the robot and the bars beyond its tips
  static APART = 0.2; // m between the bars of two policies
  static HALF_WIDTH = 0.13; // m, of a drawn panel
  static LONGEST = 2.2; // m, of a plume or an arrow
  static NOZZLES = 0.3; // m from the base's axis, on each side

  constructor(surface, robot) {
    this.surface = surface;
    this.robot = robot;
    const ends = [
      ...robot.panels.map((panel) => Math.hypot(...panel.root) + panel.length),
      ...robot.arms.map((arm) => Math.hypot(arm.mount[0], arm.mount[1]) + 1),
    ];
    this.reach = Math.max(robot.side, ...ends) + Scene.MARGIN;
  }

  /** Draw policies [{ recording, state, colour }] at a time, the first one in front; `whole` shows all of the path. */
  draw(policies, t, factor, whole) {
    const { surface, robot } = this;
    surface.clear();
    surface.ink.fillStyle = Theme.colours.space;
    surface.ink.fillRect(0, 0, surface.width, surface.height);
    const front = policies[0];
    const reach = this.reach + Scene.APART * policies.length;
    const radius = whole ? robot.path.radius + reach : reach;
    this.centre = whole || !front ? robot.path.centre : front.state.base;
    this.scale = Math.min(surface.width, surface.height) / (2 * radius);
    this.unit = Math.min(Math.max(this.scale / 45, 0.35), 1.6);
    this.drawDots();
    this.drawPath(t);
    if (!front) return;
    for (const policy of policies.slice(1).reverse()) this.drawBehind(policy, factor);
    policies.forEach((policy, rank) => this.drawSwing(policy, t, factor, rank));
    this.drawInFront(front, factor);
    this.drawKeys(front, factor);
  }

  place([x, y]) {
    const { width, height } = this.surface;
    return [width / 2 + this.scale * (x - this.centre[0]), height / 2 - this.scale * (y - this.centre[1])];
  }

  places(points) {
    return points.map((point) => this.place(point));
  }

  /** Dots that stand still in space, so that motion shows. */
  drawDots() {
    const { width, height } = this.surface;
    const apart = Math.max(2, roundStep(28 / this.scale));
    const [across, up] = [width / 2 / this.scale, height / 2 / this.scale];
    for (let x = Math.ceil((this.centre[0] - across) / apart) * apart; x < this.centre[0] + across; x += apart) {
      for (let y = Math.ceil((this.centre[1] - up) / apart) * apart; y < this.centre[1] + up; y += apart) {
        this.surface.disc(this.place([x, y]), 1.2, Theme.colours.dot);
      }
    }
  }

  drawPath(t) {
    const { path } = this.robot;
    const part = Math.min(t / path.span, 1) * (path.points.length - 1);
    const covered = [...path.points.slice(0, Math.floor(part) + 1), onPath(path, part)];
    this.surface.line(this.places(path.points), Theme.colours.ahead, 3);
    this.surface.line(this.places(covered), Theme.colours.covered, 3);
  }

  /** Another policy: outlines of base, arms and object, which hide where they are the same, and its panels. */
  drawBehind({ state, colour }, factor) {
    const { surface, robot } = this;
    surface.polygon(this.places(square(state.base, robot.side / 2)), null, colour, 2);
    for (const arm of robot.arms) surface.line(this.places(armLine(state, arm)), colour, 2);
    if (state.object.length) surface.polygon(this.places(square(state.object, 0.12)), null, colour, 2);
    robot.panels.forEach((_, k) => {
      const outline = this.panelOutline(state, k, factor);
      surface.ink.globalAlpha = 0.3;
      surface.polygon(outline, colour);
      surface.ink.globalAlpha = 1;
      surface.polygon(outline, null, colour, 1.6);
    });
  }

  drawInFront({ state, colour }, factor) {
    const { robot } = this;
    this.drawPlumes(state);
    robot.panels.forEach((_, k) => {
      const rest = this.places(panelLine(robot, state, k, state.rest, factor));
      this.surface.line(rest, Theme.colours.dim, 1.3, [5, 5]);
      this.drawPanel(state, k, factor, colour);
    });
    this.drawBase(state);
    for (const arm of [...robot.arms].sort((a, b) => a.grasps - b.grasps)) this.drawArm(state, arm);
    if (state.object.length) this.drawObject(state);
  }

  /** Both long edges of a panel, one behind the other, on the surface. */
  panelOutline(state, k, factor, from = 0, to = Infinity, low = -1, high = 1) {
    const { x } = this.robot.panels[k];
    const bent = deflections(this.robot, k, state.modes).slice(from, to);
    const edge = (side) => bent.map((w, i) =>
      this.place(fromPanel(this.robot, state, k, x[from + i], factor * w + side * Scene.HALF_WIDTH)));
    return [...edge(high), ...edge(low).reverse()];
  }

  /** A panel in bands from the root outwards, one for each piezo channel or pair, in the colours of their voltages. */
  drawPanel(state, k, factor, edge) {
    const { robot, surface } = this;
    const last = robot.panels[k].x.length - 1;
    const volts = panelVolts(robot, state, k);
    const bands = volts.length / robot.faces;
    volts.forEach((value, channel) => {
      const band = Math.floor(channel / robot.faces);
      const [from, to] = [band, band + 1].map((end) => Math.round((end * last) / bands));
      const sides = robot.faces === 1 ? [-1, 1] : channel % 2 ? [-1, 0] : [0, 1];
      const outline = this.panelOutline(state, k, factor, from, to + 1, ...sides);
      surface.polygon(outline, voltageColour(value, robot.volts));
    });
    surface.polygon(this.panelOutline(state, k, factor), null, edge, 2);
  }

  /** A bar beyond each tip: how far it swung in the last seconds. Bars of several policies lie side by side. */
  drawSwing({ recording, state, colour }, t, factor, rank) {
    const { robot, surface, unit } = this;
    robot.panels.forEach((panel, k) => {
      const along = panel.length + 0.25 + Scene.APART * rank;
      const [low, high] = swingEnds(recording, state, k, t).map((tip) => factor * tip);
      const at = (x, y) => this.place(fromPanel(robot, state, k, x, y));
      surface.line([at(along, low), at(along, high)], colour, 4 * unit);
      for (const end of [low, high]) surface.line([at(along - 0.09, end), at(along + 0.09, end)], colour, 2.5 * unit);
    });
  }

  drawBase(state) {
    const { surface, robot, unit } = this;
    const { body, edge, link } = Theme.colours;
    const half = robot.side / 2;
    surface.polygon(this.places(square(state.base, half)), body, edge, 1.8 * unit);
    const front = [[0.62, 0], [0.05, 0.42], [0.05, -0.42]].map(([x, y]) => fromBase(state, [half * x, half * y]));
    surface.polygon(this.places(front), link);
  }

  drawArm(state, arm) {
    const { surface, unit } = this;
    const { edge, link, gold, body } = Theme.colours;
    const line = this.places(armLine(state, arm));
    const width = (arm.grasps ? 6 : 3.4) * unit;
    const tip = line.at(-1);
    const [dx, dy] = plus(tip, line.at(-2), -1);
    const way = Math.atan2(dy, dx);
    surface.line(line, edge, width + 2.2 * unit);
    surface.line(line, link, width);
    if (arm.name === "antenna") {
      surface.ink.beginPath();
      surface.ink.arc(...plus(tip, [Math.cos(way), Math.sin(way)], 11 * unit), 11 * unit, way + 1.9, way - 1.9);
      surface.ink.closePath();
      surface.ink.fillStyle = body;
      surface.ink.fill();
      surface.ink.strokeStyle = edge;
      surface.ink.lineWidth = unit;
      surface.ink.stroke();
    } else if (arm.name === "camera") {
      const cone = [-0.36, 0.36].map((side) => plus(tip, [Math.cos(way + side), Math.sin(way + side)], 34 * unit));
      surface.ink.globalAlpha = 0.2;
      surface.polygon([tip, ...cone], Theme.colours.covered);
      surface.ink.globalAlpha = 1;
      surface.disc(tip, 4.5 * unit, edge);
      surface.disc(tip, 2.6 * unit, Theme.colours.covered);
    }
    for (const joint of line.slice(0, -1)) {
      surface.disc(joint, 0.62 * width, edge);
      surface.disc(joint, 0.36 * width, gold);
    }
  }

  drawObject(state) {
    const { surface, robot, unit } = this;
    const half = Math.max(...robot.grasps.flat().map(Math.abs), (5.5 * unit) / this.scale);
    surface.polygon(this.places(square(state.object, half)), Theme.colours.object, Theme.colours.edge, 1.2 * unit);
    robot.grasps.forEach((grasp, g) => {
      const force = state.grasp.slice(2 * g, 2 * g + 2);
      const size = Math.hypot(...force);
      const length = Math.min(size / robot.newtons.grasp, Scene.LONGEST) * this.scale;
      if (length < 2) return;
      const start = this.place(plus(state.object, turned(grasp, state.object[2])));
      this.drawArrow(start, [force[0] / size, -force[1] / size], length);
    });
  }

  drawArrow(start, way, length) {
    const { surface, unit } = this;
    const head = Math.min(8 * unit, 0.6 * length);
    const neck = plus(start, way, length - head);
    const side = [-way[1], way[0]];
    surface.line([start, neck], Theme.colours.force, 2.4 * unit);
    const point = [plus(start, way, length), plus(neck, side, 0.55 * head), plus(neck, side, -0.55 * head)];
    surface.polygon(point, Theme.colours.force);
  }

  /** What the thrusters blow out, against the push: two nozzles on each face, the torque from those along x. */
  drawPlumes(state) {
    const [fx, fy, torque] = state.thrust;
    const couple = torque / (2 * Scene.NOZZLES);
    const half = this.robot.side / 2;
    for (const [along, aside, force] of [
      [[1, 0], Scene.NOZZLES, fx / 2 - couple], [[1, 0], -Scene.NOZZLES, fx / 2 + couple],
      [[0, 1], 0.02, fy / 2], [[0, 1], 0.32, fy / 2],
    ]) {
      const length = Math.min(Math.abs(force) / this.robot.newtons.thrust, Scene.LONGEST);
      if (length < 0.02) continue;
      const out = along.map((value) => -Math.sign(force) * value);
      const across = [along[1], along[0]];
      const mouth = plus([half * out[0], half * out[1]], across, aside);
      for (const [colour, reach, width] of [["plume", length, 0.11], ["core", 0.55 * length, 0.055]]) {
        const belly = plus(mouth, out, 0.35 * reach);
        const flame = [plus(mouth, across, 0.7 * width), plus(belly, across, width), plus(mouth, out, reach),
          plus(belly, across, -width), plus(mouth, across, -0.7 * width)];
        this.surface.polygon(this.places(flame.map((point) => fromBase(state, point))), Theme.colours[colour]);
      }
    }
  }

  /** What the lengths mean. */
  drawKeys({ recording, state }, factor) {
    const { surface } = this;
    const { ink, dim, force, plume } = Theme.colours;
    const bottom = surface.height - 16;
    if (this.robot.panels.length) {
      surface.text(`deflections drawn ${factor}×`, 12, bottom - 36, ink);
      surface.text("dashed: without swing", 12, bottom - 18, dim);
    }
    surface.line([[12, bottom], [12 + this.scale, bottom]], dim, 2);
    surface.text("1 m", 18 + this.scale, bottom, dim);
    surface.text(`thrust ${withUnit(Math.hypot(state.thrust[0], state.thrust[1]), "N")}`, surface.width - 12, 18,
      plume, "right");
    if (recording.has("grasp")) {
      const largest = Math.max(...this.robot.grasps.map((_, g) => Math.hypot(...state.grasp.slice(2 * g, 2 * g + 2))));
      surface.text(`grasp ${withUnit(largest, "N")}`, surface.width - 12, 36, force, "right");
    }
  }
}

/** The voltages of panel `k`'s channels. */
function panelVolts(robot, state, k) {
  const count = state.volts.length / robot.panels.length;
  return state.volts.slice(k * count, (k + 1) * count);
}
