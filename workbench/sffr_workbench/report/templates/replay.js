/** The replay of an episode: which policies are shown, at what time, how; and everything that is drawn of it. */
class Replay {
  static SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16];
  static FACTORS = { least: 1, most: 20 };

  constructor(parts, episode) {
    this.parts = parts;
    this.robot = episode.robot;
    this.recordings = episode.policies.map((policy) => new Recording(policy));
    this.duration = Math.max(...this.recordings.map(({ end }) => end));
    this.shown = [...this.recordings].sort((a, b) => a.unrest - b.unrest); // the calmest in front
    Object.assign(this, { t: 0, playing: false, speed: 4, factor: 5, view: "robot" });
    document.body.classList.toggle("rigid", !this.robot.panels.length);
    const surface = new Surface(parts.stage);
    this.scene = new Scene(surface, this.robot);
    this.panels = this.robot.panels.map((_, k) => new PanelView(surface, this.robot, k));
    for (const part of [parts.tips, parts.charts, parts.spectra, parts.uses]) part.replaceChildren();
    const seek = (t) => this.seek(t);
    this.charts = timeKinds(this.robot, this.recordings).map((kind) =>
      new TimeChart(kind.aside ? parts.tips : parts.charts, kind, this.duration || this.recordings[0].step, seek));
    const spectra = this.recordings.some((recording) => recording.spectra.f.length > 0);
    parts.spectra.closest("section").hidden = !spectra; // none without panels, or of a short episode
    this.summaries = [
      ...this.robot.panels.map((_, k) => new SpectrumChart(parts.spectra, this.robot, k)),
      ...Object.keys(UseChart.NAMES).filter((group) => this.robot.panels.length || group !== "piezo")
        .map((group) => new UseChart(parts.uses, group)),
    ];
    this.views = ["robot", ...this.robot.panels.map((_, k) => `panel ${k}`), "path"];
    this.changed = () => {};
  }

  /** The policies that are shown, the first one in front, with what is drawn of them. */
  get policies() {
    return this.shown.map((recording) => ({ recording, colour: Theme.policy(recording.colour) }));
  }

  /** Show or hide a policy; one that comes back comes in front. */
  toggle(recording) {
    this.shown = this.shown.includes(recording) ? this.shown.filter((each) => each !== recording)
      : [recording, ...this.shown];
    this.refresh();
  }

  seek(t) {
    this.t = Math.min(Math.max(t, 0), this.duration);
    this.request();
  }

  play(wanted = !this.playing) {
    if (wanted && this.t >= this.duration) this.t = 0;
    this.playing = wanted;
    this.last = undefined;
    this.request();
  }

  /** The next faster (1) or slower (-1) speed. */
  step(way) {
    const { SPEEDS } = Replay;
    const at = SPEEDS.indexOf(this.speed) + way;
    this.set({ speed: SPEEDS[Math.min(Math.max(at, 0), SPEEDS.length - 1)] });
  }

  nextView() {
    this.set({ view: this.views[(this.views.indexOf(this.view) + 1) % this.views.length] });
  }

  /** Change speed, factor or view. */
  set(settings) {
    Object.assign(this, settings);
    this.factor = Math.min(Math.max(this.factor, Replay.FACTORS.least), Replay.FACTORS.most);
    this.request();
  }

  /** Draw everything anew: other policies, another size, other colours. */
  refresh() {
    const { policies } = this;
    for (const chart of [...this.charts, ...this.summaries]) chart.show(policies);
    for (const chart of this.summaries) chart.draw();
    for (const legend of document.querySelectorAll(".legend")) legend.replaceChildren(...policies.map(legendEntry));
    this.request();
  }

  /** Draw the moment before the next repaint, once however often it is asked for. */
  request() {
    this.pending ??= requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.pending = undefined;
    if (this.playing) {
      this.t = Math.min(this.t + (this.speed * (now - (this.last ?? now))) / 1000, this.duration);
      this.last = now;
      this.playing = this.t < this.duration;
      this.request();
    }
    this.draw();
    this.changed();
  }

  draw() {
    const policies = this.policies.map((policy) => ({ ...policy, state: policy.recording.at(this.t) }));
    const panel = this.views.slice(1, -1).indexOf(this.view);
    if (panel >= 0) this.panels[panel].draw(policies, this.t, this.factor);
    else this.scene.draw(policies, this.t, this.factor, this.view === "path");
    for (const chart of this.charts) chart.drawAt(this.t);
  }
}

function legendEntry({ recording, colour }) {
  const entry = document.createElement("li");
  entry.textContent = recording.name;
  entry.style.setProperty("--colour", colour);
  return entry;
}
