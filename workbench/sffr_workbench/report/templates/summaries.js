/** Spectra of a panel's vibration, on logarithmic axes, with the robot's natural frequencies. */
class SpectrumChart extends Chart {
  constructor(parent, robot, panel) {
    const { name } = robot.panels[panel];
    super(parent, `Panel ${name}: spectrum of the tip's motion [m²/Hz]`,
      `Power spectral density of the tip deflection of panel ${name} over frequency, for each policy`);
    this.frequencies = robot.frequencies;
    this.panel = panel;
  }

  show(policies) {
    this.shown = policies;
    const spectra = policies.map(({ recording }) => recording.spectra);
    const all = spectra.flatMap(({ f }) => f);
    this.across = new Axis(Math.min(...all, 1), Math.max(...all, 10), "Hz", true);
    this.up = Axis.around(spectra.map(({ psd }) => psd[this.panel]), "", true);
    const top = Math.round(Math.log10(this.up.high));
    const bottom = Math.min(...spectra.flatMap(({ psd }) => psd[this.panel]).filter((value) => value > 0));
    this.up.low = 10 ** Math.max(Math.floor(Math.log10(bottom || 1e-9)), top - 10);
    this.stale = true;
  }

  drawStill(surface) {
    for (const f of this.frequencies) {
      surface.line([this.place(f, this.up.low), this.place(f, this.up.high)], Theme.colours.dim, 1, [2, 4]);
    }
    for (const { recording: { spectra }, colour } of [...this.shown].reverse()) {
      this.drawLine(surface, spectra.f, spectra.psd[this.panel], colour, 1.6);
    }
  }
}

/** How much of the time a group of actuators uses which part of its limit: a histogram on a logarithmic axis. */
class UseChart extends Chart {
  static NAMES = { piezo: "Piezos", thruster: "Thrusters", joint: "Joints" };

  constructor(parent, group) {
    super(parent, `${UseChart.NAMES[group]}: share of the time [%]`,
      `${UseChart.NAMES[group]}: histogram of the command's part of the limit, for each policy`);
    this.group = group;
  }

  show(policies) {
    this.shown = policies;
    const uses = policies.map(({ recording }) => recording.use[this.group].map((share) => 100 * share));
    this.across = new Axis(0, uses[0]?.length ?? 1, "");
    this.up = Axis.around(uses, "%", false);
    this.uses = uses;
    this.stale = true;
  }

  /** The ends of the bins as parts of the limit: what is less, three bins a decade from 0.001 %, at the limit. */
  drawFrame() {
    const { surface, up, across } = this;
    const { line, dim } = Theme.colours;
    for (const y of up.marks()) {
      const place = this.place(0, y);
      surface.line([place, this.place(across.high, y)], line, 1);
      surface.text(this.label(y, up), Chart.ROOM.left - 8, place[1], dim, "right", 11);
    }
    const height = surface.height - Chart.ROOM.bottom / 2;
    ["0.001 %", "0.01 %", "0.1 %", "1 %", "10 %"].forEach((words, k) => {
      if (surface.width < 360 && k % 2) return;
      surface.text(words, this.place(1 + 3 * k, 0)[0], height, dim, "center", 11);
    });
    surface.text("limit", surface.width - Chart.ROOM.right, height, dim, "right", 11);
  }

  drawStill(surface) {
    const bins = this.across.high;
    const [left, base] = this.place(0, 0);
    const each = (this.place(bins, 0)[0] - left) / bins;
    const wide = (0.84 * each) / Math.max(this.shown.length, 1);
    this.shown.forEach(({ colour }, rank) => {
      this.uses[rank].forEach((share, bin) => {
        const [, top] = this.place(0, share);
        const x = left + each * (bin + 0.08) + wide * rank;
        if (share > 0) surface.polygon([[x, base], [x, Math.min(top, base - 1)], [x + wide, Math.min(top, base - 1)],
          [x + wide, base]], colour);
      });
    });
  }
}
