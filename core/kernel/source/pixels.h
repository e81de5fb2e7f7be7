/* Pixels that differ from an empty room: core/vision/detection/foreground.py. */

/* mask (h, w): 255 where any channel of an image (h, w, 3) is below `low` (h, w, 3) or more than `band` (h, w, 3) above
   it, 0 elsewhere; ends (2,): its first and last such column, 0 and -1 for none. Rows lie `stride` bytes apart. */
EXPORT int64_t STAGE(differing)(int64_t height, int64_t width, int64_t stride, const uint8_t *image, const uint8_t *low,
                                int64_t low_stride, const uint8_t *band, int64_t band_stride, uint8_t *mask,
                                int64_t *ends) {
  ends[0] = width, ends[1] = -1;
  for (int64_t y = 0; y < height; y++, image += stride, low += low_stride, band += band_stride, mask += width)
    for (int64_t x = 0; x < width; x += 16) {
      int64_t count = width - x < 16 ? width - x : 16;
      uint8_t flags[48];
      if (count == 16) {
        v16b any = {0};
        for (int i = 0; i < 48; i += 16) {
          v16b values, least, most, differs;
          memcpy(&values, image + 3 * x + i, 16);
          memcpy(&least, low + 3 * x + i, 16);
          memcpy(&most, band + 3 * x + i, 16);
          differs = (v16b)(values - least > most); /* what is below the band wraps around to above it */
          memcpy(flags + i, &differs, 16);
          any |= differs;
        }
        uint64_t halves[2];
        memcpy(halves, &any, 16);
        if (!(halves[0] | halves[1])) {
          memset(mask + x, 0, 16);
          continue;
        }
      } else {
        for (int64_t i = 0; i < 3 * count; i++)
          flags[i] = (uint8_t)(image[3 * x + i] - low[3 * x + i]) > band[3 * x + i] ? 255 : 0;
      }
      for (int64_t c = 0; c < count; c++) {
        mask[x + c] = flags[3 * c] | flags[3 * c + 1] | flags[3 * c + 2];
        if (!mask[x + c]) continue;
        if (x + c < ends[0]) ends[0] = x + c;
        if (x + c > ends[1]) ends[1] = x + c;
      }
    }
  if (ends[1] < 0) ends[0] = 0;
  return 0;
}
