# Makes of a C source (or header) for zivi.h one for zivi_f32.h: sed -f tools/c/single.sed
s/zivi\.h/zivi_f32.h/g
s/libzivi\.a/libzivi_f32.a/g
s/ZIVI_H/ZIVI_F32_H/g
s/zivi_/zivi_f32_/g
s/zivi_f32_f32/zivi_f32/g
s/double/float/g
