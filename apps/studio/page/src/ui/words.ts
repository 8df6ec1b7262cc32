// A number with what it counts: 1 run, 2 runs.
export const counted = (number: number, one: string, many = `${one}s`) => `${number} ${number === 1 ? one : many}`;
