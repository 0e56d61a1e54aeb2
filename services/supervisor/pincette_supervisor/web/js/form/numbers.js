// Reads the numbers that a person types. The command line follows the same rule.

const NUMBER = /^([+\-\u2212]?)(\d+(?:[.,]\d+)?|\d+\.|\.\d+)(?:[eE]([+-]?\d{1,3}))?$/;
const GROUPED = /^[+\-\u2212]?(?!0+,)\d{1,3},\d{3}$/;
const INTEGER = /^[+\-\u2212]?\d+$/;
const FRACTION = /^\d+(?:[eE][+-]?\d{1,3})?$/;
const SEPARATE = "separate the numbers by spaces or semicolons";

/** Return the number that a text states; throws an Error that states a valid form. */
export function numberIn(text, { whole = false } = {}) {
  const trimmed = text.trim();
  if (trimmed === "") throw new Error("a number is needed, such as 2.5");
  if (GROUPED.test(trimmed)) {
    const dotted = trimmed.replace(",", ".");
    throw new Error(`${trimmed} can be ${dotted} or ${trimmed.replace(",", "")}: write one of these`);
  }
  const found = NUMBER.exec(trimmed);
  if (!found) {
    throw new Error(`${trimmed} is not a number: write digits with at most one decimal sign, `
      + "such as 2.5 or 2,5");
  }
  const [, sign, digits, exponent = "0"] = found;
  const value = Number(`${digits.replace(",", ".")}e${exponent}`);
  if (!Number.isFinite(value) || (value === 0 && /[1-9]/.test(digits))) {
    throw new Error(`${trimmed} is outside the range of numbers`);
  }
  if (whole && !Number.isInteger(value)) throw new Error(`${trimmed} is not a whole number`);
  return value === 0 || sign === "" || sign === "+" ? value : -value;
}

/** Split a list into the texts of its items; throws an Error where a comma has two meanings. */
function itemsIn(text) {
  const trimmed = text.trim();
  if (!trimmed.includes(",")) return trimmed.split(/\s*;\s*|\s+/);
  if (!/[\s;]/.test(trimmed)) {
    const items = trimmed.split(",");
    const place = items.findIndex((item, index) => index && INTEGER.test(items[index - 1])
      && FRACTION.test(item));
    if (place > 0) {
      const [a, b] = [items[place - 1], items[place]];
      throw new Error(`${a},${b} can be ${a}.${b} or two numbers, ${a} and ${b}: ${SEPARATE}`);
    }
    return items;
  }
  if (/,(?!\s)/.test(trimmed) && /\s,|,\s/.test(trimmed)) {
    throw new Error(`a comma is used in two ways: ${SEPARATE}`);
  }
  if (!/,\s/.test(trimmed)) return trimmed.split(/\s*;\s*|\s+/);
  const items = trimmed.split(/\s*,\s+/);
  if (items.some((item) => /[\s;]/.test(item))) throw new Error(`two separators are mixed: ${SEPARATE}`);
  return items;
}

/** Return the numbers of a list; throws an Error that states a valid form. */
export function numbersIn(text) {
  const items = itemsIn(text);
  if (items.length > 1 && items.includes("")) throw new Error(`a number is missing between two separators`);
  return items.map((item) => numberIn(item));
}

/** Return the records of a text with one record a line, each with a number for every column. */
export function recordsIn(text, columns) {
  return text.trim().split("\n").map((line, place) => {
    try {
      const values = numbersIn(line);
      if (values.length !== columns.length) {
        throw new Error(`${values.length} numbers instead of ${columns.length} (${columns.join(", ")})`);
      }
      return Object.fromEntries(columns.map((name, index) => [name, values[index]]));
    } catch (error) {
      throw new Error(`line ${place + 1}: ${error.message}`);
    }
  });
}
