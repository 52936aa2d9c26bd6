/** Values over time with a cursor at the replay's time; dragging over it sets the time. */
class TimeChart extends Chart {
  /**
   * kind: { title, unit, log, about, of(recording) -> values, rest(recording) -> values or undefined }.
   * seek: called with a time that the reader chose [s].
   */
  constructor(parent, kind, duration, seek) {
    super(parent, kind.title, kind.about);
    this.kind = kind;
    this.across = new Axis(0, duration, "s");
    this.lines = new Map();
    this.shown = [];
    this.canvas.classList.add("seekable");
    const choose = (event) => {
      const { left, right } = Chart.ROOM;
      const x = event.clientX - this.canvas.getBoundingClientRect().left;
      seek(Math.min(Math.max((x - left) / (this.surface.width - left - right), 0), 1) * duration);
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      choose(event);
    });
    this.canvas.addEventListener("pointermove", (event) => event.buttons && choose(event));
  }

  /** Which policies [{ recording, colour }] are shown, the first one in front. */
  show(policies) {
    for (const { recording } of policies) {
      if (!this.lines.has(recording)) this.lines.set(recording, this.kind.of(recording));
    }
    this.shown = policies;
    this.up = Axis.around(policies.map(({ recording }) => this.lines.get(recording)), this.kind.unit, this.kind.log);
    this.stale = true;
  }

  drawStill(surface) {
    const times = (recording) => Float32Array.from({ length: recording.rows }, (_, row) => row * recording.step);
    const front = this.shown[0];
    if (front && this.kind.rest) {
      const { recording } = front;
      this.drawLine(surface, times(recording), this.kind.rest(recording), Theme.colours.dim, 1.2, [4, 4]);
    }
    for (const { recording, colour } of [...this.shown].reverse()) {
      this.drawLine(surface, times(recording), this.lines.get(recording), colour, 1.5);
    }
  }

  /** Draw the chart with the cursor at a time, unless it is out of the reader's sight and was drawn before. */
  drawAt(t) {
    const { top, bottom } = this.canvas.getBoundingClientRect();
    if (!this.stale && (bottom < 0 || top > innerHeight)) return;
    this.draw();
    const [x] = this.place(t, this.up.low);
    const { surface } = this;
    surface.line([[x, Chart.ROOM.top], [x, surface.height - Chart.ROOM.bottom]], Theme.colours.ink, 1);
    for (const { recording, colour } of [...this.shown].reverse()) {
      const row = Math.min(Math.round(t / recording.step), recording.rows - 1);
      const value = this.lines.get(recording)[row];
      if (!Number.isFinite(value)) continue;
      const [across, up] = this.place(row * recording.step, value);
      const [, top, , height] = this.frame();
      surface.disc([across, Math.min(Math.max(up, top), top + height)], 3.2, colour);
    }
  }
}

/** What is plotted over time, for a robot and its recordings. */
function timeKinds(robot, recordings) {
  const tips = robot.panels.map(({ name }, k) => ({
    title: `Tip deflection, panel ${name}`, unit: "m", aside: true,
    about: `Tip deflection of panel ${name} over time; dashed: without swing. Drag to set the time.`,
    of: (recording) => recording.column("tips", k),
    rest: (recording) => restTips(recording, k),
  }));
  const panels = robot.panels.length > 0;
  const others = [
    panels && { title: "Vibration energy", unit: "J", log: true, of: (recording) => recording.column("energy", 0) },
    { title: "Tracking error of the object", unit: "m", log: true, of: (recording) => recording.column("error", 0) },
    panels && { title: "Piezo voltage, largest", unit: "V", of: (recording) => recording.largest("volts") },
  ].filter(Boolean);
  if (recordings.some((recording) => recording.has("damping"))) {
    others.push({ title: "Virtual damping [N s/m]", unit: "", of: meanDamping });
  }
  return [...tips, ...others.map((kind) => ({ about: `${kind.title} over time. Drag to set the time.`, ...kind }))];
}

/** The tip deflections of panel `k` without swing. */
function restTips(recording, k) {
  const swing = recording.column("swing", k);
  return recording.column("tips", k).map((tip, row) => tip - swing[row]);
}

function meanDamping(recording) {
  const width = recording.layout.damping[1];
  const columns = range(0, width - 1, 1).map((k) => recording.column("damping", k));
  return columns[0].map((_, row) => columns.reduce((sum, column) => sum + column[row] / width, 0));
}
