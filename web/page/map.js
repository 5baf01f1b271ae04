// The map: streets, base station, vehicles with their ages, and who sent in the slots since the last picture.

import { paint, write } from "./canvas.js";
import { ageColour, colour, share } from "./colours.js";

const REACH = 15, MARGIN_M = 20;
/** Radius of a vehicle's disc: a share of the map's width, within limits. */
const radiusOn = (canvas) => Math.min(9, Math.max(6.5, canvas.clientWidth / 29));
/** Width of a map that has room for words. */
const WORDS_PX = 200;
/** How strong the oldest ray of a picture is beside the newest. */
const FAINTEST = 0.3;

/** Where a place in metres lies on the canvas, and back. */
function projection(canvas, { mobility }) {
  const [width, height] = [mobility.blocks_x * mobility.block_x_m, mobility.blocks_y * mobility.block_y_m];
  const scale = Math.min(canvas.clientWidth / (width + 2 * MARGIN_M), canvas.clientHeight / (height + 2 * MARGIN_M));
  const left = (canvas.clientWidth - scale * width) / 2, bottom = (canvas.clientHeight + scale * height) / 2;
  return {
    scale, width, height,
    x: (metres) => left + scale * metres,
    y: (metres) => bottom - scale * metres,
    place: (x, y) => [(x - left) / scale, (bottom - y) / scale],
  };
}

/** The vehicle under a point of the canvas, if any, and the place in metres. */
export function find(canvas, scenario, vehicles, x, y) {
  const map = projection(canvas, scenario);
  const distances = vehicles.map((vehicle) => Math.hypot(map.x(vehicle.x) - x, map.y(vehicle.y) - y));
  const nearest = distances.indexOf(Math.min(...distances));
  return { vehicle: distances[nearest] <= REACH ? vehicles[nearest] : null, place: map.place(x, y) };
}

/** A cell; `slots` is how many passed since the last picture: all of their rays are drawn, older ones fainter. */
export function drawMap(canvas, cell, vehicles, selected, slots) {
  const { scenario } = cell.about, map = projection(canvas, scenario), ring = cell.usesRing;
  paint(canvas, (context, width) => {
    drawStreets(context, scenario, map);
    const { base_station_x_m: bx, base_station_y_m: by } = scenario.cell;
    const station = [map.x(bx), map.y(by)];
    for (const outcome of ["lost", "received"]) {
      cell.sent[outcome].forEach((ago, index) => {
        const vehicle = vehicles[index];
        if (vehicle && !vehicle.jammed) drawRay(context, vehicle, map, station, outcome, 1 - (1 - FAINTEST) * ago / Math.max(slots, 1));
      });
    }
    drawStation(context, station, width > WORDS_PX);
    for (const vehicle of vehicles) drawVehicle(context, vehicle, map, radiusOn(canvas), vehicle.index === selected, ring && vehicle.called);
  });
}

function drawStreets(context, { mobility }, map) {
  const half = mobility.lane_width_m * mobility.lanes_per_direction;
  context.fillStyle = colour("street");
  context.fillRect(map.x(0), map.y(map.height), map.scale * map.width, map.scale * map.height);
  context.fillStyle = colour("block");
  for (let i = 0; i < mobility.blocks_x; i += 1) {
    for (let j = 0; j < mobility.blocks_y; j += 1) {
      const [x, y] = [map.x(i * mobility.block_x_m + half), map.y((j + 1) * mobility.block_y_m - half)];
      context.beginPath();
      context.roundRect(x, y, map.scale * (mobility.block_x_m - 2 * half), map.scale * (mobility.block_y_m - 2 * half), 4);
      context.fill();
    }
  }
}

function drawRay(context, vehicle, map, station, outcome, strength) {
  const received = outcome === "received";
  context.globalAlpha = strength;
  context.strokeStyle = colour(received ? "received" : "collided");
  context.setLineDash(received ? [] : [3, 4]);
  context.lineWidth = received ? 2 : 1.5;
  context.beginPath();
  context.moveTo(map.x(vehicle.x), map.y(vehicle.y));
  context.lineTo(...station);
  context.stroke();
  context.setLineDash([]);
  context.globalAlpha = 1;
}

function drawStation(context, [x, y], words) {
  context.fillStyle = colour("panel");
  context.strokeStyle = colour("ink");
  context.lineWidth = 2;
  context.beginPath();
  context.arc(x, y - 4, 13, 0, 2 * Math.PI);
  context.fill();
  context.beginPath();
  context.moveTo(x - 6, y + 6);
  context.lineTo(x, y - 8);
  context.lineTo(x + 6, y + 6);
  context.moveTo(x - 3.5, y + 1);
  context.lineTo(x + 3.5, y + 1);
  context.stroke();
  context.beginPath();
  context.arc(x, y - 9, 4.5, Math.PI * 1.15, Math.PI * 1.85);
  context.moveTo(x - 7, y - 12);
  context.arc(x, y - 9, 8, Math.PI * 1.15, Math.PI * 1.85);
  context.stroke();
  if (words) write(context, "base station", x + 16, y - 4, { size: 11, colour: colour("quiet") });
}

function drawVehicle(context, vehicle, map, size, selected, called) {
  const [x, y] = [map.x(vehicle.x), map.y(vehicle.y)], age = ageColour(vehicle.age);
  const ring = (radius, name, width) => {
    context.strokeStyle = colour(name);
    context.lineWidth = width;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.stroke();
  };
  context.fillStyle = age.fill;
  context.beginPath();
  context.arc(x, y, size, 0, 2 * Math.PI);
  context.fill();
  ring(size, vehicle.jammed ? "collided" : "rim", vehicle.jammed ? 3 : 1.25);
  if (called) ring(size + 2, "called", 2);
  if (selected) ring(size + 4, "ink", 2);
  write(context, String(vehicle.age), x, y + 0.5, { size: size * (vehicle.age > 999 ? 0.72 : vehicle.age > 99 ? 1 : 1.17), align: "center", colour: age.ink, weight: 600 });
  if (vehicle.jammed) {
    context.strokeStyle = colour("collided");
    context.lineWidth = 2.5;
    context.beginPath();
    context.moveTo(x - 10, y + 10);
    context.lineTo(x + 10, y - 10);
    context.stroke();
  }
}

export function drawScale(canvas) {
  paint(canvas, (context, width) => {
    const [left, right] = [2, width - 30];
    for (let x = left; x < right; x += 1) {
      context.fillStyle = ageColour(100 ** ((x - left) / (right - left))).fill;
      context.fillRect(x, 2, 1.5, 11);
    }
    for (const age of [1, 2, 5, 10, 20, 50, 100]) {
      const words = age === 100 ? "100 ms" : String(age), x = left + share(age) * (right - left);
      write(context, words, x, 24, { size: 11, align: age === 1 ? "left" : "center", colour: colour("quiet") });
    }
  });
}
