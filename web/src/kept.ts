// SPDX-License-Identifier: Apache-2.0

/**
 * What the browser keeps for the page. Where a user has it keep nothing of sites, the storage throws as soon as it is asked
 * for: then nothing was kept, and nothing is.
 */
export class Kept {
  constructor(private readonly storage: () => Storage) {}

  get(name: string): string | null {
    try {
      return this.storage().getItem(name);
    } catch {
      return null;
    }
  }

  set(name: string, value: string): void {
    try {
      this.storage().setItem(name, value);
    } catch {
      // The page has it until it is left.
    }
  }
}
