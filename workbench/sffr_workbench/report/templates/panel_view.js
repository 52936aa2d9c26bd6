/** One panel at large: its deflections under several policies along its length, from the root on the left. */
class PanelView {
  constructor(surface, robot, panel) {
    this.surface = surface;
    this.robot = robot;
    this.panel = panel;
  }

  draw(policies, t, factor) {
    const { surface, robot, panel } = this;
    surface.clear();
    surface.ink.fillStyle = Theme.colours.space;
    surface.ink.fillRect(0, 0, surface.width, surface.height);
    const { x, length, name } = robot.panels[panel];
    const left = 64;
    const scale = (surface.width - left - 60) / length; // pixels for a metre along; across for a metre times factor
    const middle = surface.height / 2;
    const place = (along, across) => [left + scale * along, middle - scale * factor * across];
    this.drawScale(place, length, (0.5 * surface.height - 56) / (scale * factor));
    const front = policies[0];
    if (!front) return;
    const line = (amplitudes) => deflections(robot, panel, amplitudes).map((w, i) => place(x[i], w));
    this.drawBands(line(front.state.modes), panelVolts(robot, front.state, panel));
    policies.map((policy, rank) => [policy, rank]).reverse().forEach(([{ recording, state, colour }, rank]) => {
      const points = line(state.modes);
      surface.line(points, colour, rank === 0 ? 3 : 2.2);
      surface.disc(points.at(-1), 4, colour);
      const beyond = length + (14 + 9 * rank) / scale;
      const ends = swingEnds(recording, state, panel, t).map((tip) => place(beyond, tip));
      surface.line(ends, colour, 4);
    });
    surface.line(line(front.state.rest), Theme.colours.ink, 1.3, [5, 5]);
    surface.text(`panel ${name}, deflections drawn ${factor}×`, 12, 18, Theme.colours.ink);
    const note = `colours: piezo voltages of ${front.recording.name}; dashed: without swing`;
    surface.text(note, 12, surface.height - 14, Theme.colours.dim);
  }

  /** The voltages as bands around the line. */
  drawBands(points, volts) {
    const { robot, surface } = this;
    const bands = volts.length / robot.faces;
    const half = 11;
    volts.forEach((value, channel) => {
      const band = Math.floor(channel / robot.faces);
      const [from, to] = [band, band + 1].map((end) => Math.round((end * (points.length - 1)) / bands));
      const [low, high] = robot.faces === 1 ? [-1, 1] : channel % 2 ? [-1, 0] : [0, 1];
      const part = points.slice(from, to + 1);
      const edge = (side) => part.map(([x, y]) => [x, y - side * half]);
      surface.polygon([...edge(high), ...edge(low).reverse()], voltageColour(value, robot.volts));
    });
  }

  /** Lines of equal deflection, in round numbers. */
  drawScale(place, length, most) {
    const { surface } = this;
    const step = roundStep(most / 3);
    for (let k = -Math.floor(most / step); k <= Math.floor(most / step); k += 1) {
      const [start, y] = place(0, k * step);
      surface.line([[start, y], place(length, k * step)], Theme.colours.dot, k ? 1 : 1.6);
      surface.text(k ? withUnit(k * step, "m") : "0", start - 8, y, Theme.colours.dim, "right", 11);
    }
    surface.text("root", place(0, 0)[0], surface.height - 34, Theme.colours.dim, "center", 11);
    surface.text("tip", place(length, 0)[0], surface.height - 34, Theme.colours.dim, "center", 11);
  }
}

/** The smallest of 1, 2, 5 times a power of ten that is no less. */
function roundStep(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((digit) => digit * power).find((step) => step >= 0.999 * value);
}
