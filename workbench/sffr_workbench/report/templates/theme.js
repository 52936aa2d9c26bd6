/** Colours for what scripts draw: those of the style sheet, read anew when the reader's light or dark mode changes. */
const Theme = {
  dark: matchMedia("(prefers-color-scheme: dark)"),
  colours: {},

  read() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "dim", "line", "card", "space", "dot", "ahead", "covered", "body", "edge", "link",
      "gold", "object", "force", "plume", "core", "panel", "positive", "negative"]) {
      this.colours[name] = style.getPropertyValue(`--${name}`).trim();
    }
  },

  /** A policy's colour, brightened on a dark ground. */
  policy(colour) {
    return this.dark.matches ? mix(colour, "#ffffff", 0.35) : colour;
  },
};

/** The colour at `share` of the way from one "#rrggbb" to another. */
function mix(from, to, share) {
  const channels = [1, 3, 5].map((at) => {
    const [a, b] = [from, to].map((colour) => parseInt(colour.slice(at, at + 2), 16));
    return Math.round(a + share * (b - a)).toString(16).padStart(2, "0");
  });
  return `#${channels.join("")}`;
}

/** A canvas as large as its place in the page, in sharp pixels; drawing is in the page's own. */
class Surface {
  constructor(canvas) {
    this.canvas = canvas;
    this.ink = canvas.getContext("2d");
  }

  /** Clear it, and follow the size that the page gives it now. */
  clear() {
    const fine = devicePixelRatio || 1;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    const [width, height] = [Math.round(this.width * fine), Math.round(this.height * fine)];
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    this.ink.setTransform(fine, 0, 0, fine, 0, 0);
    this.ink.clearRect(0, 0, this.width, this.height);
    this.ink.lineJoin = "round";
    this.ink.lineCap = "round";
    this.ink.textBaseline = "middle";
  }

  /** Draw what is within a frame [left, top, width, height] alone. */
  within(frame, draw) {
    this.ink.save();
    this.ink.beginPath();
    this.ink.rect(...frame);
    this.ink.clip();
    draw();
    this.ink.restore();
  }

  line(points, colour, width, dash = []) {
    const { ink } = this;
    ink.beginPath();
    points.forEach(([x, y], k) => (k ? ink.lineTo(x, y) : ink.moveTo(x, y)));
    ink.setLineDash(dash);
    ink.strokeStyle = colour;
    ink.lineWidth = width;
    ink.stroke();
    ink.setLineDash([]);
  }

  polygon(points, fill, edge = null, width = 1) {
    const { ink } = this;
    ink.beginPath();
    points.forEach(([x, y], k) => (k ? ink.lineTo(x, y) : ink.moveTo(x, y)));
    ink.closePath();
    if (fill) {
      ink.fillStyle = fill;
      ink.fill();
    }
    if (edge) {
      ink.strokeStyle = edge;
      ink.lineWidth = width;
      ink.stroke();
    }
  }

  disc([x, y], radius, fill) {
    this.ink.beginPath();
    this.ink.arc(x, y, radius, 0, 2 * Math.PI);
    this.ink.fillStyle = fill;
    this.ink.fill();
  }

  text(words, x, y, colour, align = "left", size = 12) {
    this.ink.font = `${size}px system-ui, sans-serif`;
    this.ink.textAlign = align;
    this.ink.fillStyle = colour;
    this.ink.fillText(words, x, y);
  }
}

const PREFIXES = ["", "m", "µ", "n", "p"];

/** A number with three digits and its unit's SI prefix, such as "12.3 mm". */
function withUnit(value, unit) {
  if (!Number.isFinite(value)) return "–";
  if (value === 0) return `0 ${unit}`;
  const power = Math.min(PREFIXES.length - 1, Math.max(0, -Math.floor(Math.log10(Math.abs(value)) / 3 + 1e-9)));
  return `${Number((value * 1000 ** power).toPrecision(3))} ${PREFIXES[power]}${unit}`;
}
