# aquanav in a container: `docker build --target core -t aquanav .` (1.4 GB of packages), or `--target full` (3 GB).
# Its RUN steps are tried in empty environments by tests/test_dockerfile.py; the image itself was not built by us.
FROM python:3.11.14-slim-bookworm AS core
WORKDIR /opt/aquanav
COPY . .
RUN pip install -c constraints.txt .
RUN useradd --create-home aquanav
USER aquanav
WORKDIR /home/aquanav
CMD ["aquanav", "doctor"]

FROM core AS full
USER root
WORKDIR /opt/aquanav
RUN pip install 'torch==2.13.0+cpu' --index-url https://download.pytorch.org/whl/cpu
RUN pip install -c constraints.txt '.[all]'
USER aquanav
WORKDIR /home/aquanav
CMD ["aquanav", "doctor"]
