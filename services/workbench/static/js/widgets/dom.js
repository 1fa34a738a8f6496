/** Elements in one call: what keeps the views short without a framework. */

const SVG = "http://www.w3.org/2000/svg";

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "text") element.textContent = value;
    else if (name === "value" || name === "checked" || name === "disabled") element[name] = value;
    else if (name === "data") for (const [k, v] of Object.entries(value)) element.dataset[k] = v;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(3).filter((c) => c !== null && c !== undefined && c !== false));
  return element;
}

/**
 * An HTML element. `on…` attributes are listeners, `text` its text, `data` its data- attributes; null leaves one out.
 * @param {string} tag
 * @param {Object|null} [attributes]
 * @param {...(Node|string|Array|null|false)} children
 * @returns {HTMLElement}
 */
export function h(tag, attributes, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

/**
 * An SVG element, as `h`.
 * @param {string} tag
 * @param {Object|null} [attributes]
 * @param {...(Node|string|Array|null|false)} children
 * @returns {SVGElement}
 */
export function s(tag, attributes, ...children) {
  return fill(document.createElementNS(SVG, tag), attributes, children);
}

/**
 * `wait` milliseconds after the last call, call.
 * @param {Function} call
 * @param {number} wait [ms]
 * @returns {Function & {cancel: Function}}
 */
export function debounce(call, wait) {
  let timer = 0;
  const later = (...args) => {
    clearTimeout(timer);
    timer = setTimeout(() => call(...args), wait);
  };
  later.cancel = () => clearTimeout(timer);
  return later;
}
