/* Windows 10 and later have this library, wine 8 has not. Rust's hash maps seed themselves from its only function. */
__declspec(dllexport) int ProcessPrng(unsigned char *data, unsigned long long size) {
    for (unsigned long long i = 0; i < size; i++) data[i] = (unsigned char)(i * 73 + 41);
    return 1;
}
