"use strict";
/* Plays episodes that report/player.py packed. No library; nothing is fetched. */

/** Undo `series` of report/player.py: first value, then differences, in units; null is NaN. */
function series(list, unit) {
  let sum = 0;
  return list.map((step) => (step === null ? NaN : (sum += step) * unit));
}

/** Index of the last of increasing values that is at most `value`; -1 if none is. */
function lastAtMost(values, value) {
  let low = 0, high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] <= value) low = middle + 1; else high = middle;
  }
  return low - 1;
}

/**
 * Round numbers within [low, high], about `count` of them: multiples of 1, 2 or 5 times a power
 * of ten. None where the span is not positive.
 */
function ticks(low, high, count) {
  const rough = (high - low) / count;
  if (!(rough > 0 && Number.isFinite(rough) && count > 0)) return [];
  const base = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * base).find((one) => one * 1.2 >= rough);
  const first = Math.ceil(low / step), found = [];
  for (let i = 0; first + i <= high / step && i <= 2 * count + 2; i += 1) {
    found.push(Number(((first + i) * step).toPrecision(12)));
  }
  return found;
}

/** Inflate and decode one episode. */
async function unpack(text) {
  const bytes = Uint8Array.from(atob(text.trim()), (c) => c.charCodeAt(0));
  const plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return decode(JSON.parse(await new Response(plain).text()));
}

/** Turn all series of an episode into numbers, m, s and rad. */
function decode(episode) {
  const length = (list) => series(list, 1e-3), columns = (list) => list.map(length);
  episode.frames = series(episode.frames, 1e-6);
  for (const polygon of episode.polygons) polygon.points = columns(polygon.points);
  for (const agent of episode.agents) {
    agent.positions = columns(agent.positions);
    for (const name of ["headings", "speeds", "clearance", "least"]) {
      if (agent[name]) agent[name] = length(agent[name]);
    }
    if (agent.kind !== "robot") continue;
    agent.decisions = series(agent.decisions, 1e-6);
    for (const path of agent.paths) path.points = columns(path.points);
    agent.stamps = agent.plans.map((plan) => plan.stamp * 1e-6);
    for (const plan of agent.plans) {
      plan.positions = columns(plan.positions);
      plan.reference = columns(plan.reference);
      for (const one of plan.forecast) {
        one.mean = columns(one.mean);
        one.ellipses = one.ellipses.map(columns);
        one.held = length(one.held);
        one.sets = one.sets.map((rim) => rim && columns(rim));
      }
    }
  }
  return episode;
}

/** The plan that a robot followed at a time; its first one before that. */
function planAt(robot, time) {
  return robot.plans[Math.max(lastAtMost(robot.stamps, time + 1e-6), 0)];
}

/** Index of the frame of the decision after (way 1) or before (way -1) a frame. */
function decisionFrom(episode, robot, index, way) {
  const now = episode.frames[index], stamps = robot.decisions;
  const here = lastAtMost(stamps, now + 1e-6);
  let wanted = way > 0 ? here + 1 : here;
  if (way < 0 && here >= 0 && stamps[here] > now - 1e-6) wanted -= 1;
  if (wanted >= stamps.length) return episode.frames.length - 1;
  return wanted < 0 ? 0 : Math.max(lastAtMost(episode.frames, stamps[wanted] + 1e-6), 0);
}

/** How a plan came about: 0 optimal, 1 its level gave way, 2 it is not the optimal one. */
function grade(plan) {
  if (!plan.best) return 2;
  return plan.gave_way ? 1 : 0;
}

/** The same in words; a sentence. */
function verdict(plan) {
  if (!plan) return "This controller makes no plans.";
  const way = plan.gave_way ? ` It gave way: ${plan.gave_way}.` : "";
  if (!plan.best) return `Not optimal: ${plan.rung}.${way}`;
  return way ? `Optimal, but it gave way: ${plan.gave_way}.` :
    `Optimal plan${plan.level ? "; it keeps the level asked for" : ""}.`;
}

/** Texts of the side panel: [label, text]. */
function facts(episode, robot, index) {
  const time = episode.frames[index], plan = planAt(robot, time);
  const number = (value, digits, unit) =>
    value === null || value === undefined || !Number.isFinite(value) ? "–" :
      `${value.toFixed(digits)}${unit ? ` ${unit}` : ""}`;
  const decision = lastAtMost(robot.decisions, time + 1e-6) + 1;
  const rows = [
    ["time", `${number(time, 2)} of ${number(episode.frames.at(-1), 2, "s")}`],
    ["decision", `${decision} of ${robot.decisions.length}`],
    ["speed", `${number(robot.speeds[index], 2)} of ${number(robot.reference_speed, 2, "m/s")}`],
    ["clearance", number(robot.clearance[index], 2, "m")],
    ["least so far", number(robot.least[index], 2, "m")],
  ];
  if (plan) {
    const share = (value) => value === null ? "no constraint" : number(100 * value, 2, "%");
    const [low, high] = plan.level ?? [null, null];
    rows.push(
      ["plan of", number(plan.stamp * 1e-6, 2, "s")],
      ["status", plan.status],
      ["rung", plan.rung],
      ["reason", plan.reason || "–"],
      ["broken", plan.breach || "–"],
      ["level", low === null ? "–" : low === high ? `${low}` : `${low} to ${high}`],
      ["least content", share(plan.content)],
      ["iterations", `${plan.iterations}`],
      ["violation", plan.violation === null ? "–" : plan.violation.toExponential(1)],
      ["left out", plan.left_out.join(", ") || "–"],
      ["fallbacks", plan.fallbacks.join("; ") || "–"],
    );
  } else {
    rows.push(["plan", "this controller makes none"]);
  }
  const at = robot.reached === null ? "not reached" : `reached at ${robot.reached.toFixed(2)} s`;
  return [...rows, ["goal", at], ["ended by", episode.ended]];
}

/** Colours of the page, by name, for light and dark. */
function palette(element) {
  const style = getComputedStyle(element);
  const names = ["paper", "ink", "muted", "line", "other", "wall", "region", "reference",
    "gave-way", "lower"];
  for (let i = 0; i < 6; i += 1) names.push(`robot-${i}`);
  return Object.fromEntries(names.map((n) => [n, style.getPropertyValue(`--${n}`).trim()]));
}

/** Colour of an agent: robots have those of the figures, others are grey. */
function colorOf(agent, colors) {
  return agent.kind === "robot" ? colors[`robot-${agent.color}`] : colors.other;
}

/** Size a canvas to its place in the page and return its context in CSS pixels. */
function prepared(canvas, height) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth;
  if (height) canvas.style.height = `${height}px`;
  const high = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(high * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(high * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, high);
  context.font = "12px system-ui, sans-serif";
  context.lineWidth = 1;
  return { context, width, height: high };
}

/**
 * Whether a player takes a key: all of its keys where it has the focus, the steps wherever that is.
 *
 * place : of the focus; "own", or "page" for the rest of the page.
 * tag, type : of the element with the focus; where the key has a use of its own, it keeps that.
 */
function takesKey(key, place, tag, type = "") {
  const steps = key === "ArrowLeft" || key === "ArrowRight";
  const typed = tag === "TEXTAREA" || (tag === "INPUT" && !["radio", "checkbox", "range"].includes(type));
  if (typed) return false;
  if (place === "page" || tag === "SELECT" || type === "radio") return steps;
  return key !== " " || !(tag === "BUTTON" || type === "checkbox");
}

if (typeof module !== "undefined") {
  module.exports = {
    series, lastAtMost, ticks, decode, planAt, decisionFrom, facts, grade, verdict, takesKey,
  };
}
