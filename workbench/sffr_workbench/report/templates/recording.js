/** One policy's episode: rows of numbers, `step` seconds apart; `layout` says which columns mean what. */
class Recording {
  static SWING = 10; // s over which a tip's swing is looked back at, about a period of the first mode

  constructor(policy) {
    const { name, colour, failure, step, rows, layout, width, spectra, use } = policy;
    Object.assign(this, { name, colour, failure, step, rows, layout, width, spectra, use });
    const bytes = Uint8Array.from(atob(policy.table), (letter) => letter.charCodeAt(0));
    this.table = new Float32Array(bytes.buffer);
    this.end = (rows - 1) * step;
  }

  /** The state at a time: an array for each name of the layout, on straight lines between the rows. */
  at(t) {
    const place = Math.min(Math.max(t / this.step, 0), this.rows - 1);
    const before = Math.min(Math.floor(place), Math.max(this.rows - 2, 0));
    const after = Math.min(before + 1, this.rows - 1);
    const share = place - before;
    const state = {};
    for (const [name, [start, width]] of Object.entries(this.layout)) {
      state[name] = Array.from({ length: width }, (_, k) => {
        const [a, b] = [before, after].map((row) => this.table[row * this.width + start + k]);
        return a + share * (b - a);
      });
    }
    return state;
  }

  /** All values of column `k` of a name. */
  column(name, k) {
    const start = this.layout[name][0] + k;
    return Float32Array.from({ length: this.rows }, (_, row) => this.table[row * this.width + start]);
  }

  /** What the panels vibrate on average [J]; infinite if the policy failed. */
  get unrest() {
    return this.failure ? Infinity : this.column("energy", 0).reduce((sum, energy) => sum + energy / this.rows, 0);
  }

  /** The largest magnitude among a name's columns, row by row. */
  largest(name) {
    const [start, width] = this.layout[name];
    return Float32Array.from({ length: this.rows }, (_, row) => {
      const from = row * this.width + start;
      return this.table.subarray(from, from + width).reduce((most, value) => Math.max(most, Math.abs(value)), 0);
    });
  }

  /** Whether a name has any number at all. */
  has(name) {
    return this.layout[name][1] > 0 && Number.isFinite(this.table[this.layout[name][0]]);
  }

  /** How far panel `k`'s tip swung to either side [m] of where it would be without swing, in the seconds before `t`. */
  swing(t, k) {
    const at = this.layout.swing[0] + k;
    const last = Math.min(Math.floor(t / this.step + 1e-6), this.rows - 1);
    const first = Math.max(Math.ceil((Math.min(t, this.end) - Recording.SWING) / this.step), 0);
    let [low, high] = [Infinity, -Infinity];
    for (let row = first; row <= last; row += 1) {
      const swing = this.table[row * this.width + at];
      low = Math.min(low, swing);
      high = Math.max(high, swing);
    }
    return [low, high];
  }
}
