/** The page: controls, keys, the table of what the policies do now, and which episode is replayed. */
const parts = {};
for (const part of document.querySelectorAll("[data-part]")) parts[part.dataset.part] = part;
const episodes = JSON.parse(document.getElementById("episodes").textContent);
let replay;

/** Replay an episode from its start. */
function load(episode) {
  replay?.play(false);
  replay = new Replay(parts, episode);
  replay.changed = showState;
  parts.time.max = replay.duration;
  parts.view.replaceChildren(...replay.views.map((view) => {
    const panel = /^panel (\d+)/.exec(view);
    return new Option(panel ? `panel ${replay.robot.panels[panel[1]].name}` : `whole ${view}`, view);
  }));
  parts.policies.replaceChildren(...replay.recordings.map(policyRow));
  replay.refresh();
}

/** A policy's row: its checkbox, and places for what it does now. */
function policyRow(recording, k) {
  const row = parts.row.content.cloneNode(true).firstElementChild;
  const box = row.querySelector("input");
  box.addEventListener("change", () => replay.toggle(recording));
  row.querySelector(".name").textContent = recording.name;
  row.querySelector("kbd").textContent = k < 9 ? k + 1 : "";
  if (recording.failure) {
    row.querySelector(".failure").textContent = `failed after ${recording.end.toFixed(1)} s: ${recording.failure}`;
  }
  return row;
}

/** Bring controls and numbers up to the replay. */
function showState() {
  const { t, duration, playing, speed, factor, view } = replay;
  parts.time.value = t;
  parts.time.setAttribute("aria-valuetext", `${t.toFixed(1)} of ${duration.toFixed(1)} seconds`);
  parts.clock.textContent = `${t.toFixed(1)} / ${duration.toFixed(1)} s`;
  parts.play.textContent = playing ? "Pause" : "Play";
  parts.speed.value = speed;
  parts.factor.value = factor;
  parts.factorText.textContent = `${factor}×`;
  parts.view.value = view;
  const swings = replay.recordings.map((recording) => Math.max(0, ...replay.robot.panels.map((_, k) => {
    const [low, high] = recording.swing(t, k);
    return high - low;
  })));
  const most = Math.max(...swings, 1e-9);
  replay.recordings.forEach((recording, k) => showPolicy(parts.policies.children[k], recording, swings[k], most));
}

function showPolicy(row, recording, swing, most) {
  const state = recording.at(replay.t);
  const shown = replay.shown.includes(recording);
  row.querySelector("input").checked = shown;
  row.classList.toggle("hidden", !shown);
  row.classList.toggle("front", replay.shown[0] === recording);
  row.style.setProperty("--colour", Theme.policy(recording.colour));
  row.style.setProperty("--share", `${(100 * swing) / most}%`);
  const values = {
    swing: withUnit(swing, "m"), energy: withUnit(state.energy[0], "J"), error: withUnit(state.error[0], "m"),
    volts: withUnit(Math.max(0, ...state.volts.map(Math.abs)), "V"),
  };
  for (const [name, words] of Object.entries(values)) row.querySelector(`.${name}`).textContent = words;
}

/** What the keys do; the page lists them. */
function press(event) {
  const { target, key, shiftKey } = event;
  if (event.ctrlKey || event.metaKey || event.altKey || target.matches("select, textarea")) return;
  const slides = target.matches("input[type=range]");
  if (slides && /^(Arrow|Home|End|Page)/.test(key)) return;
  if (key === " " && target.matches("button, summary, input[type=checkbox], a")) return;
  const actions = {
    " ": () => replay.play(),
    ArrowLeft: () => replay.seek(replay.t - (shiftKey ? 5 : 0.5)),
    ArrowRight: () => replay.seek(replay.t + (shiftKey ? 5 : 0.5)),
    Home: () => replay.seek(0),
    End: () => replay.seek(replay.duration),
    "+": () => replay.step(1),
    "=": () => replay.step(1),
    "-": () => replay.step(-1),
    e: () => replay.set({ factor: replay.factor + 1 }),
    E: () => replay.set({ factor: replay.factor - 1 }),
    z: () => replay.nextView(),
    Z: () => replay.nextView(),
  };
  const policy = /^[1-9]$/.test(key) ? replay.recordings[Number(key) - 1] : undefined;
  const action = policy ? () => replay.toggle(policy) : actions[key];
  if (!action) return;
  event.preventDefault();
  action();
}

if (episodes.length) {
  Theme.read();
  parts.speed.replaceChildren(...Replay.SPEEDS.map((speed) => new Option(`${speed}×`, speed)));
  parts.episode.replaceChildren(...episodes.map(({ name }, k) => new Option(name, k)));
  parts.episode.closest("label").hidden = episodes.length < 2;
  parts.episode.addEventListener("change", () => load(episodes[parts.episode.value]));
  parts.play.addEventListener("click", () => replay.play());
  parts.time.addEventListener("input", () => replay.seek(Number(parts.time.value)));
  parts.speed.addEventListener("change", () => replay.set({ speed: Number(parts.speed.value) }));
  parts.view.addEventListener("change", () => replay.set({ view: parts.view.value }));
  parts.factor.addEventListener("input", () => replay.set({ factor: Number(parts.factor.value) }));
  document.addEventListener("keydown", press);
  const redraw = () => {
    Theme.read();
    replay.refresh();
  };
  Theme.dark.addEventListener("change", redraw);
  addEventListener("scroll", () => replay.request(), { passive: true });
  load(episodes[0]);
  new ResizeObserver(redraw).observe(document.body);
}
