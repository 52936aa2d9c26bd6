/** A range of values and where they lie on a stretch of the page. */
class Axis {
  static DECADES = 5; // of a logarithmic axis at most

  constructor(low, high, unit, log = false) {
    Object.assign(this, { low, high, unit, log });
  }

  /** What holds all values: round ends about zero, or from zero, or whole powers of ten. */
  static around(lists, unit, log) {
    let [low, high] = [Infinity, -Infinity];
    for (const values of lists) {
      for (const value of values) {
        if (!Number.isFinite(value) || (log && value <= 0)) continue;
        low = Math.min(low, value);
        high = Math.max(high, value);
      }
    }
    if (high < low) return new Axis(log ? 1e-6 : 0, log ? 1e-5 : 1, unit, log);
    if (log) {
      const top = Math.ceil(Math.log10(high) - 1e-9);
      const bottom = Math.min(Math.max(Math.floor(Math.log10(low)), top - Axis.DECADES), top - 1);
      return new Axis(10 ** bottom, 10 ** top, unit, true);
    }
    const step = roundStep((Math.max(high, 0) - Math.min(low, 0) || 1) / 4);
    const ends = [Math.floor(Math.min(low, 0) / step + 1e-6), Math.ceil(Math.max(high, 0) / step - 1e-6)];
    return new Axis(ends[0] * step, (ends[1] - ends[0] < 1 ? ends[0] + 1 : ends[1]) * step, unit);
  }

  /** 0 at the low end, 1 at the high one. */
  share(value) {
    if (this.log) return Math.log(Math.max(value, this.low * 1e-6) / this.low) / Math.log(this.high / this.low);
    return (value - this.low) / (this.high - this.low);
  }

  /** Values of the grid lines. */
  marks() {
    if (this.log) {
      const [first, last] = [Math.ceil(Math.log10(this.low) - 1e-9), Math.floor(Math.log10(this.high) + 1e-9)];
      const every = Math.ceil((last - first) / 5);
      return range(first, last, every).map((power) => 10 ** power);
    }
    const step = roundStep((this.high - this.low) / 5);
    return range(Math.ceil(this.low / step - 1e-6), Math.floor(this.high / step + 1e-6), 1).map((k) => k * step);
  }
}

function range(first, last, every) {
  return Array.from({ length: Math.floor((last - first) / every) + 1 }, (_, k) => first + k * every);
}

/** A chart's frame: a title in the page, a canvas, and two axes; what stands still is drawn once and kept. */
class Chart {
  static ROOM = { left: 62, right: 12, top: 8, bottom: 24 };

  /** Add a chart to a part of the page; `about` says to a screen reader what it shows. */
  constructor(parent, title, about) {
    this.figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    caption.textContent = title;
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", about);
    this.figure.append(caption, this.canvas);
    parent.append(this.figure);
    this.surface = new Surface(this.canvas);
    this.kept = new Surface(document.createElement("canvas"));
    this.stale = true;
  }

  /** The page's places of values on both axes. */
  place(x, y) {
    const { left, right, top, bottom } = Chart.ROOM;
    const { width, height } = this.surface;
    return [left + this.across.share(x) * (width - left - right),
      height - bottom - this.up.share(y) * (height - top - bottom)];
  }

  /** The frame's left, top, width and height. */
  frame() {
    const { left, right, top, bottom } = Chart.ROOM;
    return [left, top, this.surface.width - left - right, this.surface.height - top - bottom];
  }

  /** Draw everything; subclasses draw what stands still in `drawStill(surface)`. */
  draw() {
    const { surface } = this;
    surface.clear();
    if (this.stale || this.keptWidth !== surface.canvas.width || this.keptHeight !== surface.canvas.height) {
      this.drawFrame();
      surface.within(this.frame(), () => this.drawStill(surface));
      const copy = this.kept.canvas;
      [copy.width, copy.height] = [this.keptWidth, this.keptHeight] = [surface.canvas.width, surface.canvas.height];
      if (copy.width && copy.height) this.kept.ink.drawImage(surface.canvas, 0, 0);
      this.stale = false;
    } else if (surface.width && surface.height) {
      surface.ink.drawImage(this.kept.canvas, 0, 0, surface.width, surface.height);
    }
  }

  drawFrame() {
    const { surface, across, up } = this;
    const { line, dim } = Theme.colours;
    const { left, right, bottom } = Chart.ROOM;
    for (const y of up.marks()) {
      const place = this.place(across.low, y);
      surface.line([place, this.place(across.high, y)], line, 1);
      surface.text(this.label(y, up), left - 8, place[1], dim, "right", 11);
    }
    const marks = across.marks();
    const room = (surface.width - left - right) / Math.max(marks.length, 1);
    const every = Math.ceil(46 / Math.max(room, 1));
    marks.forEach((x, k) => {
      if (k % every) return;
      const words = k + every < marks.length || !across.unit ? this.label(x, { unit: "" }) : this.label(x, across);
      const near = this.place(x, up.low)[0];
      const align = near > surface.width - right - 14 ? "right" : "center";
      surface.text(words, align === "right" ? surface.width - 2 : near, surface.height - bottom / 2, dim, align, 11);
    });
  }

  label(value, { unit }) {
    if (value === 0 && unit !== "%") return "0";
    const digits = `${Number(value.toPrecision(3))}`;
    if (unit === "") return Math.abs(value) < 0.001 ? value.toExponential(0) : digits;
    return ["s", "Hz", "%"].includes(unit) ? `${digits} ${unit}` : withUnit(value, unit);
  }

  /** A line through values at places; gaps where there is none. */
  drawLine(surface, xs, ys, colour, width, dash = []) {
    let part = [];
    for (let k = 0; k < xs.length; k += 1) {
      if (Number.isFinite(ys[k])) part.push(this.place(xs[k], ys[k]));
      if (part.length && (!Number.isFinite(ys[k]) || k === xs.length - 1)) {
        surface.line(part, colour, width, dash);
        part = [];
      }
    }
  }
}
